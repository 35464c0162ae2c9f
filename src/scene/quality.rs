//! Named sets of defaults, from fast to accurate. What they cost and bring is in docs/tradeoff.md.

use super::Settings;

/// Defaults of the knobs that trade accuracy for time; whatever a flag or a scene file says goes over them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quality {
    /// For a first look: noisy, in a fraction of the time.
    Draft,
    /// The usual defaults.
    #[default]
    Normal,
    /// For a picture that is to be kept.
    High,
    /// As refined as is sensible; for the truth take the model path.
    Reference,
}

impl Quality {
    /// The defaults.
    pub fn settings(self) -> Settings {
        let normal = Settings::default();
        match self {
            Quality::Draft => Settings {
                candidates: 16,
                directions: 12,
                environment_directions: 16,
                projection_steps: 4,
                spp: 12,
                ..normal
            },
            Quality::Normal => normal,
            Quality::High => Settings {
                candidates: 192,
                directions: 128,
                environment_directions: 128,
                gather_step: 0.5,
                spp: 96,
                ..normal
            },
            Quality::Reference => Settings {
                candidates: 1024,
                directions: 768,
                environment_directions: 512,
                hidden_share: 1.0,
                camera_step: 0.25,
                gather_step: 0.25,
                proxy_step: 1.0,
                spp: 384,
                ..normal
            },
        }
    }
}
