//! Real volumes, where they are at hand: a folder `shared/volumes` beside the checkout, or the one named by
//! TYNDALL_VOLUMES. They are not part of the repository.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use tyndall::volume::{self, ScalarType, active_fraction, summary};

struct Expected {
    file: &'static str,
    dims: [u32; 3],
    scalar: ScalarType,
    spacing: [f64; 3],
    /// Signs of the voxel steps along world LPS x, y, z.
    signs: [f64; 3],
    range: (f64, f64),
    /// Threshold and share of voxels above it.
    active: &'static [(f64, f64)],
}

/// From the README.md that lies beside the files.
const VOLUMES: [Expected; 8] = [
    Expected {
        file: "skull_ct.nrrd",
        dims: [256, 256, 108],
        scalar: ScalarType::I16,
        spacing: [0.957, 0.957, 1.5],
        signs: [1.0, -1.0, 1.0],
        range: (-1024.0, 2986.0),
        active: &[(300.0, 0.062), (600.0, 0.043), (900.0, 0.025)],
    },
    Expected {
        file: "head_ct.nrrd",
        dims: [256, 256, 99],
        scalar: ScalarType::U16,
        spacing: [1.0, 1.0, 2.0],
        signs: [1.0, 1.0, -1.0],
        range: (0.0, 3272.0),
        active: &[(600.0, 0.281), (1200.0, 0.067)],
    },
    Expected {
        file: "heart_ct.nii.gz",
        dims: [120, 126, 164],
        scalar: ScalarType::I16,
        spacing: [1.5; 3],
        // Its sform's first two axes run negative in RAS, so positive in LPS.
        signs: [1.0, 1.0, 1.0],
        range: (-1078.0, 3343.0),
        active: &[(150.0, 0.181), (250.0, 0.129)],
    },
    Expected {
        file: "heart_ct_mask.nii.gz",
        dims: [120, 126, 164],
        scalar: ScalarType::U8,
        spacing: [1.5; 3],
        signs: [1.0, 1.0, 1.0],
        range: (0.0, 1.0),
        active: &[(0.5, 0.080)],
    },
    Expected {
        file: "bonsai_ct.nii.gz",
        dims: [256; 3],
        scalar: ScalarType::U8,
        spacing: [1.0; 3],
        signs: [-1.0, -1.0, 1.0],
        range: (0.0, 255.0),
        active: &[(20.0, 0.131), (40.0, 0.092), (100.0, 0.062)],
    },
    Expected {
        file: "engine_ct.mha",
        dims: [256, 256, 110],
        scalar: ScalarType::U8,
        spacing: [1.0; 3],
        signs: [1.0, 1.0, 1.0],
        range: (0.0, 255.0),
        active: &[(70.0, 0.161), (150.0, 0.023)],
    },
    Expected {
        file: "vessels_avm.nii.gz",
        dims: [337, 319, 154],
        scalar: ScalarType::U8,
        spacing: [0.5469, 0.5469, 1.0],
        signs: [-1.0, -1.0, 1.0],
        range: (0.0, 563.2),
        active: &[(100.0, 0.021), (200.0, 0.010)],
    },
    Expected {
        file: "smoke_plume.nrrd",
        dims: [111, 222, 112],
        scalar: ScalarType::F32,
        spacing: [0.47619; 3],
        signs: [1.0, 1.0, 1.0],
        range: (0.0, 5.71),
        active: &[(0.01, 0.223), (0.1, 0.094)],
    },
];

fn folder() -> PathBuf {
    std::env::var_os("TYNDALL_VOLUMES")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/volumes"), PathBuf::from)
}

#[test]
fn real_volumes_load_as_described() {
    for expected in VOLUMES {
        let path = folder().join(expected.file);
        if !path.exists() {
            // Written past the test harness, which would swallow it.
            writeln!(std::io::stderr(), "SKIPPED: no {}; set TYNDALL_VOLUMES to its folder", path.display()).unwrap();
            continue;
        }
        let name = expected.file;
        let v = volume::load(&path, None).unwrap();
        assert_eq!((v.grid.dims, v.data.scalar_type()), (expected.dims, expected.scalar), "{name}");
        for axis in 0..3 {
            let spacing = v.grid.spacing()[axis];
            assert!((spacing - expected.spacing[axis]).abs() < 5e-4, "{name}: spacing {axis} is {spacing}");
            // All of them lie along the world's axes.
            let step = v.grid.index_to_world.matrix3.col(axis)[axis];
            assert!((step - expected.signs[axis] * spacing).abs() < 1e-9, "{name}: step {axis} is {step}");
        }
        let s = summary(&v);
        let tolerance = 0.01 * expected.range.1.abs().min(5.0);
        assert!((s.min - expected.range.0).abs() <= tolerance, "{name}: min {}", s.min);
        assert!((s.max - expected.range.1).abs() <= tolerance, "{name}: max {}", s.max);
        assert_eq!((s.nan_count, s.inf_count), (0, 0), "{name}");
        for &(threshold, share) in expected.active {
            let active = active_fraction(&v, threshold);
            assert!((active - share).abs() <= 0.0006, "{name}: {active} above {threshold}, not {share}");
        }
    }
}
