//! Whole renders against closed forms and published orders of scattering, and against symmetries of the scene.
//!
//! "transport" = the project's table of reference values for radiative transfer (DESIGN section 5); the id of each case
//! is given. Irradiance 1 unless said otherwise.

#[path = "common/bodies.rs"]
mod bodies;
mod common;
#[path = "common/data.rs"]
mod data;
#[path = "common/transport.rs"]
mod transport;

use bodies::{random_values, turn_scene};
use glam::{DAffine3, DMat3, DVec3, Vec3, Vec4};
use std::ops::ControlFlow;
use transport::{
    SLAB_REFLECTED, SLAB_TRANSMITTED, aim, assert_near, ball, homogeneous, matter, mean, sun, unit_cube, voxel_slab,
};
use tyndall::output::Picture;
use tyndall::render::{Internals, Renderer};
use tyndall::scene::camera::look_at;
use tyndall::scene::{Background, Environment, Light, Model, Sampling, Scene};
use tyndall::verify::single::box_radiance;
use tyndall::vk::{Context, Validation};
use tyndall::volume::{Grid, VoxelData};

/// Runs `body` on a device, but not under GPU-assisted validation: lavapipe takes up to a minute for each kernel that it
/// has instrumented, and these dozens of renders use those that the passes' own tests run under it.
fn gpu_test(body: impl FnOnce(&Context)) {
    if common::validation() == Validation::GpuAssisted {
        println!("SKIP whole renders under GPU-assisted validation");
    } else {
        common::gpu_test(body);
    }
}

fn render(ctx: &Context, scene: &Scene) -> Picture {
    let mut renderer = Renderer::new(ctx, scene, Internals::default()).unwrap();
    renderer.render(scene.settings.seed, &mut |_| ControlFlow::Continue(())).unwrap()
}

/// The picture's mean in one pencil of rays: the same ray for every pixel, other random numbers in each.
fn pencil(ctx: &Context, scene: &mut Scene, origin: [f64; 3], direction: [f64; 3]) -> Vec4 {
    aim(scene, origin, direction, [32, 32]);
    mean(&render(ctx, scene))
}

/// exp(−τ) along an axis, along a diagonal, and along the oblique rays of transport B-box4 and B-box5. Rays end at a
/// transmittance of 1e-3, so nothing below that is told apart.
#[test]
fn transmittance() {
    gpu_test(|ctx| {
        let axis = ([-1.0, 0.4, 0.6], [1.0, 0.0, 0.0], 1.0);
        let third = 3f64.sqrt().recip();
        let diagonal = ([-1.0; 3], [third; 3], 3f64.sqrt());
        let box4 = ([-1.0, 0.3, 0.2], [0.9407208683835973, 0.18814417367671946, 0.2822162605150792], 1.063014581273465);
        let box5 =
            ([1.5, 1.25, 1.75], [-0.5698028822981898, -0.4558423058385518, -0.6837634587578277], 1.4624940645653537);
        for (extinction, (origin, direction, length)) in [
            (1e-6, axis),
            (1e-3, axis),
            (1.0, axis),
            (1.0, diagonal),
            (8.0, box4),
            (1.0, box5),
            (10.0, axis),
            (1e6, axis),
        ] {
            let mut scene = homogeneous(unit_cube(5), extinction, Vec3::ZERO);
            let expected = (-extinction * length).exp();
            let case = format!("extinction {extinction}, length {length}");
            // Single precision: of the length (1e-6), and of 1 − T.
            let tolerance = if expected > 1e-3 { 3e-6 } else { 1e-3 };
            let alpha = pencil(ctx, &mut scene, origin, direction).w;
            assert_near(&case, alpha, -(-extinction * length).exp_m1(), tolerance);
            scene.background = Background::Color(Vec3::new(1.0, 2.0, 0.5));
            let seen = pencil(ctx, &mut scene, origin, direction);
            assert_near(&case, seen.x, expected, tolerance);
            assert_near(&case, seen.y, 2.0 * expected, 2.0 * tolerance);
            assert_near(&case, seen.z, 0.5 * expected, tolerance);
        }
    });
}

/// Transport, group B, `box_single_scattering`: radiance per albedo of order 1 in a cube under a parallel beam.
#[test]
fn box_single_scattering() {
    // id, σ_t, g, light's travel, ray origin, ray direction, radiance
    type Case = (&'static str, f64, f32, [f64; 3], [f64; 3], [f64; 3], f64);
    let down = [0.0, -1.0, 0.0];
    let half = 0.5f64.sqrt();
    let third = 3f64.sqrt().recip();
    let (x, minus_z) = ([1.0, 0.0, 0.0], [0.0, 0.0, -1.0]);
    let light4 = [0.4364357804719848, -0.8728715609439696, 0.2182178902359924];
    let ray4 = [0.9407208683835973, 0.18814417367671946, 0.2822162605150792];
    let ray5 = [-0.5698028822981898, -0.4558423058385518, -0.6837634587578277];
    let light7 = [-0.9901475429766743, -0.09901475429766743, -0.09901475429766743];
    let cases: [Case; 9] = [
        ("B-box0-sigma1-g0", 1.0, 0.0, down, [-1.0, 0.75, 0.5], x, 0.03917566983490719),
        ("B-box1-sigma8-g0.75", 8.0, 0.75, down, [0.5, 2.0, 0.5], down, 0.003248059697578898),
        ("B-box2-sigma1-g0.75", 1.0, 0.75, down, [0.5, -1.0, 0.5], [0.0, 1.0, 0.0], 0.8196976413404683),
        ("B-box3-sigma1-g0.75", 1.0, 0.75, [half, -half, 0.0], [-1.0, 0.5, 0.5], x, 0.0033435016367016884),
        ("B-box3-sigma8-g0", 8.0, 0.0, [half, -half, 0.0], [-1.0, 0.5, 0.5], x, 0.032964957423407396),
        ("B-box4-sigma8-g0", 8.0, 0.0, light4, [-1.0, 0.3, 0.2], ray4, 0.025388821255225714),
        ("B-box5-sigma1-g0", 1.0, 0.0, [third, -third, third], [1.5, 1.25, 1.75], ray5, 0.03409439691179118),
        (
            "B-box6-sigma8-g0",
            8.0,
            0.0,
            [0.0, 0.0, 1.0],
            [0.25, -0.5, 0.125],
            [0.0, 0.8944271909999159, 0.4472135954999579],
            0.002737619077257847,
        ),
        ("B-box7-sigma8-g0.75", 8.0, 0.75, light7, [0.9, 0.5, 3.0], minus_z, 0.007223451275920551),
    ];
    gpu_test(|ctx| {
        let albedo = Vec3::new(1.0, 0.5, 0.0);
        for (id, extinction, g, travel, origin, direction, expected) in cases {
            // What `verify` expects is the table's value.
            let integral = box_radiance(extinction, g.into(), travel, origin, direction);
            assert_near(id, integral as f32, expected, 1e-6 * expected);
            let mut scene = homogeneous(unit_cube(6), extinction, albedo);
            scene.g = g;
            scene.lights.push(sun(travel));
            scene.settings.spp = 16;
            let seen = pencil(ctx, &mut scene, origin, direction);
            // 1024 pixels of 16 stratified points each: a standard error below 1e-3. Shadow rays that end at e⁻⁷ and
            // camera rays that end at 1e-3 miss another 1e-3.
            assert_near(id, seen.x, expected, 4e-3 * expected);
            assert_near(id, seen.y, 0.5 * expected, 2e-3 * expected);
            assert_eq!(seen.z, 0.0, "{id}");
        }
    });
}

/// Order by order: 1 is exact, and the error of the stored later ones (below 1 % with voxels of 1/4 of a mean free path)
/// falls with the voxels' size, down to what noise hides.
#[test]
fn slab_orders() {
    gpu_test(|ctx| {
        // Relative errors of orders 1 to 4 with voxels of 1/2 and 1/4 of a mean free path. Streams of random numbers
        // belong to orders, so differences of renders are orders.
        let errors = [2, 4].map(|layers| {
            let sums = [1, 2, 3, 4].map(|k| f64::from(mean(&render(ctx, &voxel_slab(layers, k, true))).x));
            let orders = [sums[0], sums[1] - sums[0], sums[2] - sums[1], sums[3] - sums[2]];
            [0, 1, 2, 3].map(|k| orders[k] / SLAB_REFLECTED[k] - 1.0)
        });
        let [coarse, fine] = errors;
        println!("slab orders: {errors:.4?}");
        assert!(coarse[0].abs() < 2e-3 && fine[0].abs() < 2e-3, "{errors:.4?}");
        assert!(fine[1..].iter().all(|e| e.abs() < 0.01), "{errors:.4?}");
        // 0.4 % of noise.
        for k in 1..4 {
            assert!(fine[k].abs() < 0.004 + 0.6 * coarse[k].abs(), "order {}: {errors:.4?}", k + 1);
        }
        let transmitted = mean(&render(ctx, &voxel_slab(4, 4, false))).x;
        assert_near("transmitted", transmitted, SLAB_TRANSMITTED.iter().sum(), 0.015 * transmitted as f64);
    });
}

/// The ball of optical radius ½ in an environment of radiance 1.
fn furnace_ball(n: u32) -> Scene {
    let mut scene = ball(n, 0.5);
    scene.environment = Some(Environment::Constant(Vec3::ONE));
    scene.background = Background::Environment;
    scene.settings.model = Model::Multiple;
    scene.settings.sampling = Sampling::Phase;
    scene.settings.directions = 32;
    scene.settings.environment_directions = 32;
    scene
}

/// Transport F-orders-R0.5-g0, impact parameters 0 and 0.5: radiance of orders 0 to 6 out of a white ball in a uniform
/// environment of radiance 1. Their sum, with all later ones, is 1 (E-furnace-4-g0).
const BALL_ORDERS: [(f64, [f64; 7]); 2] = [
    (
        0.0,
        [
            0.36787944117144233,
            0.41819678717071557,
            0.14469600136790292,
            0.047343875501314116,
            0.015047586747860726,
            0.004713162428203423,
            0.0014656231007870244,
        ],
    ),
    (
        0.5,
        [
            0.4206200260541148,
            0.39807697057777014,
            0.12522772290048023,
            0.03877250236835193,
            0.01196348174816898,
            0.003691024641478878,
            0.0011392843200948412,
        ],
    ),
];

/// The white furnace: every order of the environment's light counts once, and together they hide the ball.
#[test]
fn white_furnace() {
    gpu_test(|ctx| {
        for (impact, orders) in BALL_ORDERS {
            let mut before = 0.0;
            for k in [1, 2, 3, 6] {
                let mut scene = furnace_ball(16);
                scene.settings.orders = k;
                let seen = pencil(ctx, &mut scene, [impact, -5.0, 0.0], [0.0, 1.0, 0.0]);
                let expected: f64 = orders[..=k as usize].iter().sum();
                assert_near(&format!("impact {impact}, {k} orders"), seen.x, expected, 0.01);
                assert!(seen.x > before && seen.x < 1.005, "{before} {seen}");
                before = seen.x;
            }
        }
    });
}

/// A medium that emits as much as it absorbs from an environment of the same radiance is not seen at all (Kirchhoff):
/// emission unscattered and scattered, and the environment's light, each count once.
#[test]
fn thermal_equilibrium() {
    gpu_test(|ctx| {
        for (albedo, g) in [(0.0, 0.0), (0.5, 0.0), (0.5, 0.4)] {
            let mut scene = furnace_ball(12);
            scene.transfer = matter(1.0, Vec3::splat(albedo), Vec3::ONE);
            scene.g = g;
            scene.settings.orders = 6;
            let seen = pencil(ctx, &mut scene, [0.3, -5.0, 0.2], [0.0, 1.0, 0.0]);
            // For g ≠ 0 light goes from order to order by two moments.
            assert_near(&format!("albedo {albedo}, g {g}"), seen.x, 1.0, if g == 0.0 { 0.005 } else { 0.02 });
        }
    });
}

/// Order 0 is emission alone: (1 − albedo) L_e (1 − e^−τ). The first order adds what is scattered once.
#[test]
fn emission() {
    gpu_test(|ctx| {
        let emitted = Vec3::new(2.0, 1.0, 0.0);
        let unscattered = -(-2f64).exp_m1();
        let seen = |ctx: &Context, albedo: f32, model: Model, orders: u32| {
            let mut scene = homogeneous(unit_cube(6), 2.0, Vec3::splat(albedo));
            scene.transfer = matter(2.0, Vec3::splat(albedo), emitted);
            (scene.settings.model, scene.settings.orders) = (model, orders);
            pencil(ctx, &mut scene, [-1.0, 0.4, 0.6], [1.0, 0.0, 0.0])
        };
        for model in [Model::Single, Model::Multiple] {
            let black = seen(ctx, 0.0, model, 3);
            // A half float cut to 11 bits.
            assert_near("black", black.x, 2.0 * unscattered, 2e-3);
            assert_near("black", black.y, unscattered, 1e-3);
            assert_eq!(black.z, 0.0);
        }
        let zero = 0.5 * 2.0 * unscattered;
        let sums = [1, 2, 3, 4].map(|k| f64::from(seen(ctx, 0.5, Model::Multiple, k).x));
        let orders = [sums[0] - zero, sums[1] - sums[0], sums[2] - sums[1], sums[3] - sums[2]];
        // Each scattering keeps half of what stays inside.
        assert!(orders[0] > 0.1 * zero && orders[0] < 0.5 * zero, "{orders:?}");
        assert!(orders.windows(2).all(|o| o[1] > 0.1 * o[0] && o[1] < 0.5 * o[0]), "{orders:?}");
        assert_near("single is the first order", seen(ctx, 0.5, Model::Single, 4).x, sums[0], 1e-6);
    });
}

fn cloud() -> Scene {
    let mut scene = bodies::cloud([12, 12]);
    scene.settings.spp = 4;
    scene
}

/// Largest difference of two pictures, in units of the brightest pixel.
fn largest_difference(a: &Picture, b: &Picture) -> f32 {
    let most = b.pixels.iter().flatten().copied().fold(0.0, f32::max);
    a.pixels.iter().flatten().zip(b.pixels.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) / most
}

const MODELS: [Model; 4] = [Model::Absorption, Model::Phong, Model::Single, Model::Multiple];

/// Nothing depends on the order of the lights but sums that are rounded otherwise (to half floats in the cache).
#[test]
fn exchanging_two_lights_changes_nothing() {
    gpu_test(|ctx| {
        for model in [Model::Phong, Model::Single, Model::Multiple] {
            let mut scene = cloud();
            scene.settings.model = model;
            scene.settings.sampling = Sampling::Phase;
            let before = render(ctx, &scene);
            scene.lights.reverse();
            let difference = largest_difference(&render(ctx, &scene), &before);
            assert!(difference < 1e-3, "{model:?}: {difference}");
        }
    });
}

/// The same matter at the same place, stored with its axes in another order and direction.
#[test]
fn storage_order_is_not_seen() {
    gpu_test(|ctx| {
        for model in MODELS {
            let mut scene = cloud();
            scene.settings.model = model;
            scene.environment = None;
            // What gathers draw per index is another noise: no light but what the camera sees of delta lights.
            scene.settings.orders = 1;
            scene.emission_scale = 0.0;
            let before = render(ctx, &scene);
            // New voxel (i, j, k) is the old (8 − k, i, j).
            let old = scene.volume.clone();
            let dims = [7, 5, 9];
            let source = |n: usize| {
                let (i, j, k) = (n % 7, n / 7 % 5, n / 35);
                old.value((j * 7 + i) * 9 + 8 - k) as f32
            };
            scene.volume_mut().data = VoxelData::F32((0..315).map(source).collect());
            let permute = DMat3::from_cols(DVec3::Y, DVec3::Z, -DVec3::X);
            let to_old = DAffine3 { matrix3: permute, translation: DVec3::new(9.0, 0.0, 0.0) };
            scene.volume_mut().grid = Grid { dims, index_to_world: old.grid.index_to_world * to_old };
            let difference = largest_difference(&render(ctx, &scene), &before);
            assert!(difference < 2e-3, "{model:?}: {difference}");
        }
    });
}

/// Everything turned by 90° about z is the same picture; of `multiple` the same mean, since directions are not turned.
#[test]
fn turning_the_whole_scene_changes_nothing() {
    gpu_test(|ctx| {
        for model in MODELS {
            let mut scene = cloud();
            scene.settings.model = model;
            scene.settings.sampling = Sampling::Phase;
            scene.settings.directions = 64;
            scene.environment = None;
            let before = render(ctx, &scene);
            let turn = DMat3::from_cols(DVec3::Y, -DVec3::X, DVec3::Z);
            turn_scene(&mut scene, turn);
            let after = render(ctx, &scene);
            if model == Model::Multiple {
                let (a, b) = (mean(&after), mean(&before));
                assert!(((a - b) / b).abs().max_element() < 0.01, "{a} instead of {b}");
            } else {
                let difference = largest_difference(&after, &before);
                assert!(difference < 2e-3, "{model:?}: {difference}");
            }
        }
    });
}

#[test]
fn an_empty_volume_shows_the_background() {
    gpu_test(|ctx| {
        for model in MODELS {
            let mut scene = cloud();
            scene.volume_mut().data = VoxelData::F32(vec![0.0; 315]);
            scene.settings.model = model;
            for (background, expected) in [
                (Background::Color(Vec3::new(0.25, 0.5, 2.0)), [0.25, 0.5, 2.0, 1.0]),
                (Background::Transparent, [0.0; 4]),
            ] {
                scene.background = background;
                assert!(render(ctx, &scene).pixels.iter().all(|&p| p == expected), "{model:?}, {background:?}");
            }
        }
    });
}

/// NaN is empty space, infinities are the ends of the scale: the picture is that of finite values in their place.
#[test]
fn scalars_that_are_no_numbers() {
    gpu_test(|ctx| {
        for model in MODELS {
            let mut scene = cloud();
            scene.settings.model = model;
            let values = |nan: f32, most: f32, least: f32| {
                let mut values = random_values(12, 315);
                for (i, v) in values.iter_mut().enumerate() {
                    *v = match i % 11 {
                        0 => nan,
                        4 => most,
                        7 => least,
                        _ => *v,
                    };
                }
                VoxelData::F32(values)
            };
            scene.volume_mut().data = values(0.0, 10.0, -10.0);
            let expected = render(ctx, &scene);
            scene.volume_mut().data = values(f32::NAN, f32::INFINITY, f32::NEG_INFINITY);
            let got = render(ctx, &scene);
            assert!(got.pixels.iter().flatten().all(|c| c.is_finite()), "{model:?}");
            // Shading reads its neighbours' values for the gradient, so `phong` may differ.
            assert!(model == Model::Phong || got.pixels == expected.pixels, "{model:?}");
        }
    });
}

/// Extremes of DESIGN section 8: finite and not negative, whatever the scene.
#[test]
fn extremes_stay_finite() {
    gpu_test(|ctx| {
        let check = |case: &str, change: &dyn Fn(&mut Scene)| {
            for model in [Model::Phong, Model::Multiple] {
                let mut scene = cloud();
                scene.settings.model = model;
                scene.settings.spp = 1;
                change(&mut scene);
                let picture = render(ctx, &scene);
                let is_right = |c: &f32| c.is_finite() && *c >= 0.0;
                assert!(picture.pixels.iter().flatten().all(is_right), "{case}, {model:?}");
                let lit = picture.pixels.iter().any(|p| p[3] > 0.0);
                assert!(lit, "{case}, {model:?}: nothing is seen");
            }
        };
        check("camera inside", &|s| {
            let (low, high) = s.volume.grid.world_bounds();
            s.camera = look_at(0.5 * (low + high), high, DVec3::Z, 90.0);
        });
        check("light at a voxel's centre", &|s| {
            let position = s.volume.grid.index_to_world.transform_point3(DVec3::new(4.5, 3.5, 2.5));
            s.lights.push(Light::Point { position, intensity: Vec3::splat(1e6) });
        });
        check("forward", &|s| s.g = 0.999);
        check("backward", &|s| s.g = -0.999);
        check("nearly isotropic", &|s| s.g = 1e-6);
        check("dense", &|s| s.density_scale = 1e6);
        check("64 lights", &|s| {
            s.lights = (0..64).map(|i| sun([0.0, (f64::from(i)).cos(), (f64::from(i)).sin()])).collect();
        });
        check("a sun of 1e5", &|s| {
            if let Some(Environment::LatLong(sky)) = &mut s.environment {
                sky.pixels[3] = [1e5; 3];
            }
        });
        check("tiny voxels", &|s| {
            s.volume_mut().grid.index_to_world =
                DAffine3::from_scale(DVec3::splat(1e-6)) * s.volume.grid.index_to_world;
            s.camera.position *= 1e-6;
            s.density_scale = 1e6;
        });
        check("all-different bright and dark lights", &|s| {
            s.lights.push(Light::Directional { direction: DVec3::X, irradiance: Vec3::new(1e-20, 1e20, 0.0) });
        });
    });
}
