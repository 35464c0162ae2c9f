//! Ctrl-C: asked once, a command stops between two dispatches and leaves nothing half done; asked again, at once.

use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

static IS_ASKED: AtomicBool = AtomicBool::new(false);

/// From now on, Ctrl-C (and SIGTERM, SIGHUP) only ask. Who calls this looks at [`is_asked`] often.
pub fn listen() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let result = ctrlc::set_handler(|| {
            if IS_ASKED.swap(true, Ordering::Relaxed) {
                std::process::exit(crate::error::STOPPED.into());
            }
        });
        if let Err(error) = result {
            log::warn!("Ctrl-C stops this at once, since the system refuses to say when it is pressed: {error}");
        }
    });
}

/// Shall we stop?
pub fn is_asked() -> bool {
    IS_ASKED.load(Ordering::Relaxed)
}
