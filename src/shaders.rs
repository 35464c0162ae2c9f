//! The compiled shaders and what reflection knows of them, written by `build.rs`.

/// A compiled compute shader.
#[derive(Debug)]
pub struct ShaderInfo {
    /// File name in `glsl/` without its extension.
    pub name: &'static str,
    /// SPIR-V, optimised, little endian.
    pub spirv: &'static [u8],
    /// Resources of set 0, by binding number.
    pub bindings: &'static [BindingInfo],
    /// Bytes of the push-constant block; 0 = none.
    pub push_bytes: u32,
    /// Specialization constants by name.
    pub specialization: &'static [SpecInfo],
    /// Invocations of a workgroup along x, y, z.
    pub local_size: [LocalSize; 3],
}

/// One resource that a shader uses.
#[derive(Debug)]
pub struct BindingInfo {
    /// Block name in snake case, or the image variable's name.
    pub name: &'static str,
    /// Number in set 0.
    pub binding: u32,
    /// What must be bound.
    pub kind: BindingKind,
    /// What the shader declares to do with it (`readonly`, `writeonly`).
    pub access: BindingAccess,
}

/// Kind of a resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the variants are Vulkan's descriptor types")]
pub enum BindingKind {
    StorageBuffer,
    StorageImage,
    SampledImage,
}

/// What a shader does with a resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the variants say it")]
pub enum BindingAccess {
    Read,
    Write,
    ReadWrite,
}

/// One specialization constant (32 bits).
#[derive(Debug)]
pub struct SpecInfo {
    /// Name in GLSL; `WORKGROUP` for `local_size_x_id`.
    pub name: &'static str,
    /// `constant_id`.
    pub id: u32,
}

/// Workgroup size along one axis.
#[derive(Clone, Copy, Debug)]
pub enum LocalSize {
    /// Written in the shader.
    Fixed(u32),
    /// A specialization constant.
    Specialized {
        /// `constant_id`.
        id: u32,
        /// Value when not specialised.
        default: u32,
    },
}

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));
