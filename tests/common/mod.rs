//! The harness of every GPU test: a fresh context with validation, and after the body the proof that nothing was
//! reported and nothing leaked.

#![allow(dead_code, reason = "each test file uses a part of it")]

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, Once, PoisonError};
use tyndall::vk::{Context, ContextConfig, Message, Validation};

/// Validation of this run: `TYNDALL_VALIDATION=core` (default) or `gpu-assisted`.
pub fn validation() -> Validation {
    match std::env::var("TYNDALL_VALIDATION").as_deref() {
        Err(_) | Ok("core") => Validation::CoreAndSync,
        Ok("gpu-assisted") => Validation::GpuAssisted,
        Ok(other) => panic!("TYNDALL_VALIDATION={other}: it must be 'core' or 'gpu-assisted'"),
    }
}

/// True when the long sweeps were asked for (`scripts/test --full`).
pub fn is_full() -> bool {
    std::env::var_os("TYNDALL_FULL").is_some()
}

/// The device and the validation of this run.
pub fn config() -> ContextConfig {
    let device = std::env::var("TYNDALL_DEVICE").ok();
    ContextConfig { device, validation: validation(), ..ContextConfig::default() }
}

/// A context under validation. Without device or layer the test fails and says what to install.
pub fn context() -> Context {
    context_with_cache(None)
}

/// The same, which keeps compiled pipelines in a folder.
pub fn context_with_cache(cache_dir: Option<PathBuf>) -> Context {
    let config = ContextConfig { cache_dir, ..config() };
    let ctx = Context::new(&config).unwrap_or_else(|e| panic!("{e}"));
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let d = ctx.device_info();
        eprintln!("device: {} | {} | subgroup {} | {:?}", d.name, d.driver, d.subgroup_size, config.validation);
    });
    ctx
}

/// One context at a time. The validation layer looks its devices up in a map without a lock, while the start of another
/// device adds to it (Vulkan-ValidationLayers issue 4391); once in some dozen runs the heap was found destroyed. lavapipe
/// uses all cores for one context anyway.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Holds others up until it is dropped.
pub fn one_at_a_time() -> MutexGuard<'static, ()> {
    // A test that failed has poisoned nothing.
    ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs `body` and returns every message of its context, teardown included.
pub fn messages_of(body: impl FnOnce(&Context)) -> Vec<Message> {
    let _turn = one_at_a_time();
    let ctx = context();
    body(&ctx);
    ctx.close()
}

/// Runs `body`; any message or leak fails the test.
pub fn gpu_test(body: impl FnOnce(&Context)) {
    assert_silent(&messages_of(body));
}

/// Runs `body` on lavapipe without worker threads, which runs one workgroup after another; skips elsewhere.
pub fn tiles_in_order_test(body: impl FnOnce(&Context)) {
    if std::env::var("LP_NUM_THREADS").as_deref() != Ok("0") {
        println!("SKIP: tiles in order need lavapipe with LP_NUM_THREADS=0");
        return;
    }
    gpu_test(|ctx| {
        if ctx.is_cpu() {
            body(ctx);
        }
    });
}

/// Fails with the first of any messages.
#[track_caller]
pub fn assert_silent(messages: &[Message]) {
    assert!(messages.is_empty(), "{} validation message(s):\n{}", messages.len(), {
        messages.iter().take(10).map(|m| m.to_string()).collect::<Vec<_>>().join("\n")
    });
}
