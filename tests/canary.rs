//! Proves that the harness can fail: each fault below must be noticed, else the suite is blind on this machine.

mod common;

use tyndall::abi::CanaryPush;
use tyndall::shaders;
use tyndall::vk::{Access, Buffer, Context, Message, Pipeline, Recorder, Validation};

const WORDS: usize = 1024;

fn setup(ctx: &Context) -> (Pipeline, [Buffer<u32>; 3]) {
    let pipeline = Pipeline::new(ctx, &shaders::CANARY, &[("WORKGROUP", 64)]).unwrap();
    let data: Vec<u32> = (0..WORDS as u32).collect();
    (pipeline, ["a", "b", "c"].map(|name| ctx.upload(name, &data).unwrap()))
}

fn copy(rec: &mut Recorder, pipeline: &Pipeline, from: &Buffer<u32>, to: &Buffer<u32>, shift: u32) {
    let push = CanaryPush { count: WORDS as u32, shift };
    rec.dispatch(pipeline, &[("source", from.bind()), ("target", to.bind())], &push, [WORDS as u32 / 64, 1, 1]);
}

fn ids(messages: &[Message]) -> Vec<&str> {
    messages.iter().map(|m| m.id.as_str()).collect()
}

#[test]
fn correct_work_is_silent_and_right() {
    common::gpu_test(|ctx| {
        let (pipeline, [a, b, c]) = setup(ctx);
        let mut rec = Recorder::new(ctx).unwrap();
        copy(&mut rec, &pipeline, &a, &b, 0);
        rec.barrier(Access::ComputeWrite, Access::ComputeRead);
        copy(&mut rec, &pipeline, &b, &c, 0);
        rec.submit_and_wait().unwrap();
        let expected: Vec<u32> = (2..WORDS as u32 + 2).collect();
        assert_eq!(ctx.read_back(&c).unwrap(), expected);
    });
}

#[test]
fn missing_barrier_is_noticed_by_the_layer_and_by_us() {
    let messages = common::messages_of(|ctx| {
        let (pipeline, [a, b, c]) = setup(ctx);
        let mut rec = Recorder::new(ctx).unwrap();
        copy(&mut rec, &pipeline, &a, &b, 0);
        copy(&mut rec, &pipeline, &b, &c, 0);
        rec.submit_and_wait().unwrap();
    });
    assert!(ids(&messages).contains(&"TYNDALL-HAZARD"), "{messages:?}");
    if common::validation() == Validation::CoreAndSync {
        assert!(ids(&messages).iter().any(|id| id.starts_with("SYNC-HAZARD-READ-AFTER-WRITE")), "{messages:?}");
    }
}

#[test]
fn write_after_write_is_noticed_by_us() {
    let messages = common::messages_of(|ctx| {
        let (pipeline, [a, b, c]) = setup(ctx);
        let mut rec = Recorder::new(ctx).unwrap();
        copy(&mut rec, &pipeline, &a, &c, 0);
        copy(&mut rec, &pipeline, &b, &c, 0);
        rec.submit_and_wait().unwrap();
    });
    assert!(messages.iter().any(|m| m.id == "TYNDALL-HAZARD" && m.text.contains("write after write")), "{messages:?}");
}

#[test]
fn leaked_buffer_is_noticed() {
    // It leaks the device as well, upon which layer 1.4.309 with GPU-assisted validation aborts the process at its end.
    if common::validation() == Validation::GpuAssisted {
        return;
    }
    let messages = common::messages_of(|ctx| {
        std::mem::forget(ctx.device_buffer::<u32>("forgotten", 16).unwrap());
    });
    let leaks = messages.iter().filter(|m| m.id == "TYNDALL-LEAK").count();
    assert!(leaks > 0 && messages.iter().any(|m| m.text.contains("forgotten")), "{messages:?}");
}

#[test]
fn wrong_usage_is_noticed_by_core_validation() {
    if common::validation() != Validation::CoreAndSync {
        return;
    }
    // A workgroup beyond the device's limit.
    let messages = common::messages_of(|ctx| {
        let _ = Pipeline::new(ctx, &shaders::CANARY, &[("WORKGROUP", 1 << 20)]);
    });
    assert!(ids(&messages).iter().any(|id| id.starts_with("VUID-")), "{messages:?}");
}

#[test]
fn out_of_bounds_write_is_noticed_by_gpu_assisted_validation() {
    if common::validation() != Validation::GpuAssisted {
        return;
    }
    let messages = common::messages_of(|ctx| {
        let (pipeline, [a, b, _c]) = setup(ctx);
        let mut rec = Recorder::new(ctx).unwrap();
        copy(&mut rec, &pipeline, &a, &b, 1);
        rec.submit_and_wait().unwrap();
    });
    assert!(messages.iter().any(|m| m.text.contains("out of bounds") || m.text.contains("access")), "{messages:?}");
}
