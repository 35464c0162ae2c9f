//! Procedural phantoms.
