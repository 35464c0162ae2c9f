//! Homogeneous bodies, beams and pencils of rays: scenes whose pictures are known numbers.

use crate::output::Picture;
use crate::scene::camera::{Framing, frame, look_at};
use crate::scene::{
    Background, Exposure, Light, Model, OpacityUnit, Sampling, Scene, Settings, ToneCurve, TransferFunction,
    TransferPoint,
};
use crate::volume::{Grid, Volume, VoxelData};
use glam::{DVec3, DVec4, Vec3, Vec4};

/// Pixels of a pencil of rays: all see the same, each with other random numbers.
pub const PENCIL: [u32; 2] = [32, 32];

/// Radiance reflected by the slab of optical thickness 1 with isotropic scattering, beam and view along the normal,
/// irradiance 1: orders 1 to 4 at albedo 1 (reference table, C-orders-tau1-g0).
pub const SLAB_REFLECTED: [f64; 4] =
    [0.03440391594751168, 0.019994490961503873, 0.012062339284547696, 0.007382176843607174];
/// The same, transmitted.
pub const SLAB_TRANSMITTED: [f64; 4] =
    [0.029274915762159584, 0.018499081127750193, 0.01161057606134278, 0.007243913835294062];

/// Mean over the pixels.
pub fn mean(picture: &Picture) -> Vec4 {
    let sum: DVec4 = picture.pixels.iter().map(|&p| Vec4::from(p).as_dvec4()).sum();
    (sum / picture.pixels.len() as f64).as_vec4()
}

/// One extinction, albedo and emission where the scalar is 1, nothing where it is 0, linear in between.
pub fn matter(extinction: f64, albedo: Vec3, emission: Vec3) -> TransferFunction {
    let point = |value: f64| TransferPoint {
        value,
        color: albedo.to_array(),
        opacity: (value * extinction) as f32,
        emission: emission.to_array(),
    };
    TransferFunction { points: vec![point(0.0), point(1.0)], opacity_unit: OpacityUnit::Extinction }
}

/// A homogeneous box in darkness, before a transparent background; model `single`, one sample per pixel.
pub fn homogeneous(grid: Grid, extinction: f64, albedo: Vec3) -> Scene {
    Scene {
        transfer: matter(extinction, albedo, Vec3::ZERO),
        camera: frame(&grid, &Framing::default(), PENCIL),
        views: vec![],
        volume: Volume {
            name: "homogeneous".into(),
            grid,
            data: VoxelData::F32(vec![1.0; grid.voxels() as usize]),
            slope: 1.0,
            intercept: 0.0,
        }
        .into(),
        g: 0.0,
        albedo_scale: Vec3::ONE,
        density_scale: 1.0,
        emission_scale: 1.0,
        lights: Vec::new(),
        environment: None,
        background: Background::Transparent,
        // A pencil of rays sees so few cells that the noise of the others would be seen too.
        settings: Settings { model: Model::Single, hidden_share: 1.0, spp: 1, size: PENCIL, ..Settings::default() },
        exposure: Exposure::Stops(0.0),
        tone: ToneCurve::Linear,
        path: None,
    }
}

/// The unit cube between the origin and (1, 1, 1), in `n`³ voxels.
pub fn unit_cube(n: u32) -> Grid {
    let spacing = 1.0 / f64::from(n);
    Grid::axis_aligned([n; 3], [spacing; 3], [spacing / 2.0; 3])
}

/// A directional light of irradiance 1 that travels along `direction`.
pub fn sun(direction: [f64; 3]) -> Light {
    Light::Directional { direction: direction.into(), irradiance: Vec3::ONE }
}

/// Aims the camera so that every pixel sees the same ray.
pub fn aim(scene: &mut Scene, origin: [f64; 3], direction: [f64; 3], size: [u32; 2]) {
    let (origin, direction) = (DVec3::from(origin), DVec3::from(direction));
    let up = if direction.z.abs() > 0.9 { DVec3::Y } else { DVec3::Z };
    scene.camera = look_at(origin, origin + direction, up, 1e-4);
    scene.settings.size = size;
}

/// A slab of optical thickness `tau`, z from 0 to 1, `width` wide, in a single voxel; model `path`, which has no grid
/// error.
pub fn slab(tau: f64, width: f64, albedo: Vec3) -> Scene {
    let grid = Grid::axis_aligned([1, 1, 1], [width, width, 1.0], [0.0, 0.0, 0.5]);
    let mut scene = homogeneous(grid, tau, albedo);
    scene.settings.model = Model::Path;
    scene
}

/// Light of irradiance 1 on a slab from above, at cosine `mu0` to its normal.
pub fn beam(scene: &mut Scene, mu0: f64) {
    scene.lights.push(sun([(1.0 - mu0 * mu0).max(0.0).sqrt(), 0.0, -mu0]));
}

/// Sees the light that leaves a slab through the top (`reflected`) or the bottom at cosine `mu`, at the azimuth
/// `phi_degrees` from the beam's.
pub fn look(scene: &mut Scene, reflected: bool, mu: f64, phi_degrees: f64) {
    let sine = (1.0 - mu * mu).max(0.0).sqrt();
    let (s, c) = phi_degrees.to_radians().sin_cos();
    let leaves = DVec3::new(sine * c, sine * s, if reflected { mu } else { -mu });
    let surface = DVec3::new(0.0, 0.0, if reflected { 1.0 } else { 0.0 });
    aim(scene, (surface + leaves).to_array(), (-leaves).to_array(), PENCIL);
}

/// The middle of a slab of optical thickness 1 (z from 0 to 1), wide enough to be infinite (e⁻⁵ of the light comes from
/// beyond its sides), in voxels of `1/layers`, lit along the normal from above; seen along the normal, by `multiple`.
pub fn voxel_slab(layers: u32, orders: u32, is_from_above: bool) -> Scene {
    let spacing = 1.0 / f64::from(layers);
    let grid = Grid::axis_aligned([16 * layers, 16 * layers, layers], [spacing; 3], [spacing / 2.0; 3]);
    let mut scene = homogeneous(grid, 1.0, Vec3::ONE);
    scene.lights.push(sun([0.0, 0.0, -1.0]));
    scene.settings.model = Model::Multiple;
    scene.settings.sampling = Sampling::Phase;
    scene.settings.orders = orders;
    scene.settings.directions = 16;
    scene.settings.spp = 16;
    scene.settings.size = PENCIL;
    let middle = DVec3::new(8.0, 8.0, 0.5);
    let eye = middle + DVec3::new(0.0, 0.0, if is_from_above { 1000.0 } else { -1000.0 });
    // Sees a square of side 6 and nothing but directions with μ > 0.99999.
    scene.camera = look_at(eye, middle, DVec3::Y, 2.0 * (3.0f64 / 1000.0).atan().to_degrees());
    scene
}
