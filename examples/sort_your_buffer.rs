//! Sorts a `VkBuffer` of this program's own, on its own device, in its own command buffer.
//!
//!     cargo run --example sort_your_buffer [-- --validate]
#![allow(unsafe_code, reason = "a program that talks to Vulkan itself")]

pub mod own_device;

use ash::vk::{AccessFlags2, PipelineStageFlags2, ValidationFeatureEnableEXT};
use own_device::OwnDevice;
use tyndall::primitives::{BorrowedDevice, Buffer, Context, Count, Order, Payloads, Recorder, Recording, Sort};

fn main() -> tyndall::Result<()> {
    println!("{}", run(std::env::args().any(|argument| argument == "--validate"))?);
    Ok(())
}

/// What there is to tell; `validate`: under the validation layer, which panics if it has something to say.
pub fn run(validate: bool) -> tyndall::Result<String> {
    let own = OwnDevice::new(validate.then_some(ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION));
    let count = 1_000_000;
    let own_keys = own.buffer(count);
    let random = std::iter::successors(Some(1u32), |x| Some(x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223)));
    own_keys.write(0, &random.take(count).map(|x| (x as f32 - 2e9).to_bits()).collect::<Vec<_>>());

    // Once: around the device.
    let OwnDevice { instance, physical, device, queue_family, .. } = &own;
    let borrowed =
        BorrowedDevice { instance, physical: *physical, device, queue_family: *queue_family, cache_dir: None };
    // SAFETY: device and instance live until the end of this function, and the features are on.
    let ctx = unsafe { Context::borrowed(&borrowed) }?;
    let sort = Sort::<f32>::new(&ctx, Order::Descending, Payloads::None)?;
    let scratch = sort.scratch(&ctx, count as u32)?;
    // SAFETY: a storage buffer of the device, which is kept as long.
    let keys = unsafe { Buffer::<f32>::borrowed(&ctx, "keys", own_keys.handle, 0, own_keys.bytes) }?;

    // For every command buffer. What the host wrote before the submission, the device sees.
    let commands = own.begin();
    // SAFETY: the command buffer is recording, and `recorded` is kept until it is done.
    let mut recording = Recording::new(&ctx, unsafe { Recorder::borrowed(&ctx, commands) })?;
    sort.record_keys(&mut recording, &keys, Count::Host(count as u32), 0..32, &scratch)?;
    let recorded = recording.finish()?;
    // From the sort's last access, as its documentation says, to what comes next.
    let sorted = (PipelineStageFlags2::COMPUTE_SHADER, AccessFlags2::SHADER_STORAGE_WRITE);
    own.barrier(commands, sorted, (PipelineStageFlags2::HOST, AccessFlags2::HOST_READ));
    own.end(commands);
    own.submit_and_wait(commands);
    let report = recorded.check()?;

    let sorted: Vec<f32> = own_keys.read().into_iter().map(f32::from_bits).collect();
    assert!(sorted.is_sorted_by(|a, b| a >= b), "not sorted");
    assert!(own.messages().is_empty(), "{:?}", own.messages());
    Ok(format!("{count} keys sorted, from {} down to {}; {report:?}", sorted[0], sorted[count - 1]))
}
