//! What the targets share.

use std::cell::OnceCell;
use std::path::Path;

/// Calls `read` with the path of a file that holds `bytes` and whose name ends with `ending`, beside nothing else. What `read`
/// refuses is fine; a panic, a hang or a large allocation is what is looked for.
pub fn with_file(ending: &str, bytes: &[u8], read: impl FnOnce(&Path)) {
    thread_local! {
        static FOLDER: OnceCell<tempfile::TempDir> = const { OnceCell::new() };
    }
    FOLDER.with(|folder| {
        let folder = folder.get_or_init(|| tempfile::tempdir().expect("a folder for temporary files"));
        let path = folder.path().join(format!("input{ending}"));
        std::fs::write(&path, bytes).expect("room for a small file");
        read(&path);
    });
}

/// Looks at a volume as far as a renderer does before it goes to the device.
pub fn look_at(volume: &tyndall::volume::Volume) {
    let [x, y, z] = volume.grid.dims.map(u64::from);
    assert_eq!(volume.data.len() as u64, x * y * z, "voxels and size differ");
    let (low, high) = volume.grid.world_bounds();
    assert!(low.is_finite() && high.is_finite(), "the volume lies nowhere");
    let _ = tyndall::volume::active_fraction(volume, 0.5);
}
