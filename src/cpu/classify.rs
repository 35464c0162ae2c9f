//! Twin of `classify.comp` and `include/transfer.glsl`.

use super::texture::Texture;
use crate::abi::{SceneParams, TransferPointData};
use crate::passes::classify::Emitted;
use crate::shaders::constants::{DIFFERENCE_SCALE, MAX_HALF, NO_VALUE};
use glam::{Vec3, Vec4};

/// What a scalar stands for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Material {
    /// σ_t [1/unit].
    pub extinction: f32,
    /// Colour of the transfer function.
    pub color: [f32; 3],
    /// Emitted radiance.
    pub emission: [f32; 3],
}

/// −ln(1 − α), by its series where the subtraction would cancel.
pub fn optical_depth_of_opacity(opacity: f32) -> f32 {
    let a = opacity.min(1.0 - 1.0 / 65536.0);
    if a < 0.02 { a * (1.0 + a * (0.5 + a * (1.0 / 3.0 + a * (0.25 + a * 0.2)))) } else { -(1.0 - a).ln() }
}

/// Extinction of an opacity (or of an extinction) of the transfer function.
pub fn extinction(scene: &SceneParams, opacity: f32) -> f32 {
    let depth =
        if scene.unit_distance > 0.0 { optical_depth_of_opacity(opacity) / scene.unit_distance } else { opacity };
    scene.density_scale * depth
}

/// The transfer function at `value`.
pub fn classify(scene: &SceneParams, points: &[TransferPointData], value: f32) -> Material {
    if value == NO_VALUE {
        return Material::default();
    }
    let low = points.partition_point(|p| p.value <= value);
    let a = points[low.max(1) - 1];
    let b = points[low.min(points.len() - 1)];
    let scale = if a.value.abs().max(b.value.abs()) > 1.0 { DIFFERENCE_SCALE } else { 1.0 };
    let (along, width) = (scale * value - scale * a.value, scale * b.value - scale * a.value);
    let t = if width > 0.0 { (along / width).clamp(0.0, 1.0) } else { 0.0 };
    let mix = |a: f32, b: f32| a * (1.0 - t) + b * t;
    let mix3 = |a: [f32; 3], b: [f32; 3]| [mix(a[0], b[0]), mix(a[1], b[1]), mix(a[2], b[2])];
    Material {
        extinction: extinction(scene, mix(a.opacity, b.opacity)),
        color: mix3(a.color, b.color),
        emission: mix3(a.emission, b.emission).map(|e| e * scene.emission_scale),
    }
}

/// Albedo per channel.
pub fn albedo_of(scene: &SceneParams, m: &Material) -> [f32; 3] {
    std::array::from_fn(|c| (m.color[c] * scene.albedo_scale[c]).clamp(0.0, 1.0))
}

/// What `classify.comp` writes beside that: rgb = σ_s, a = extinction.
pub fn scattering(scene: &SceneParams, points: &[TransferPointData], scalar: &Texture<f32>) -> Texture<Vec4> {
    let texel = |&value: &f32| {
        let m = classify(scene, points, value);
        Vec3::from(albedo_of(scene, &m)).extend(1.0) * (m.extinction / scene.max_extinction)
    };
    Texture::new(scene.dims, scalar.texels.iter().map(texel).collect())
}

/// What `classify.comp` writes: rgb = emitted source, a = extinction, in the units of the fields.
pub fn field(
    scene: &SceneParams,
    points: &[TransferPointData],
    scalar: &Texture<f32>,
    emitted: Emitted,
) -> Texture<Vec4> {
    let texel = |&value: &f32| {
        let m = classify(scene, points, value);
        let extinction = m.extinction / scene.max_extinction;
        let source = match emitted {
            Emitted::Nothing => Vec3::ZERO,
            Emitted::Emission => (1.0 - Vec3::from(albedo_of(scene, &m))) * Vec3::from(m.emission),
            Emitted::Color => Vec3::from(m.color),
        };
        (source * extinction * scene.radiance_scale).min(Vec3::splat(MAX_HALF)).extend(extinction)
    };
    Texture::new(scene.dims, scalar.texels.iter().map(texel).collect())
}
