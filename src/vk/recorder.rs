//! Explicit recording: dispatches, copies, barriers that name both accesses, labels, timestamps, submission.

use super::access::{ALL_STAGES, Access, HazardTracker};
use super::buffer::{Bind, Buffer, HostWords, RawBuffer};
use super::context::{Context, DeviceShared};
use super::image::{Image, RawImage, init_barrier};
use super::injection::Injection;
use super::pipeline::{Pipeline, RawPipeline, descriptor_type};
use super::validation::Severity;
use crate::shaders::{BindingAccess, BindingKind};
use crate::{Error, Result};
use ash::vk;
use bytemuck::Pod;
use gpu_allocator::MemoryLocation;
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Passes that one recorder can time.
const MAX_PASSES: u32 = 256;
/// Descriptor sets of one pool.
const SETS_PER_POOL: u32 = 64;
/// A submission that takes longer than this is taken for a hang. Submissions are kept far shorter; the margin is for
/// software devices under validation.
const TIMEOUT: Duration = Duration::from_secs(600);

/// GPU time of one pass.
#[derive(Clone, Debug, PartialEq)]
pub struct TimedPass {
    /// Name given to `begin_pass`.
    pub name: &'static str,
    /// Scattering order or other counter given to `begin_pass`.
    pub iteration: u32,
    /// Dispatches recorded in it.
    pub dispatches: u32,
    /// Milliseconds between the timestamps around it; 0 where the device has none.
    pub ms: f64,
}

/// What a recorder keeps alive until the device is done.
#[allow(dead_code, reason = "held for their Drop only")]
enum Keep {
    Buffer(Arc<RawBuffer>),
    Image(Arc<RawImage>),
    Pipeline(Arc<RawPipeline>),
}

/// Identity of a descriptor set's contents: resource id, and byte range or filter.
type SetKey = (vk::DescriptorSetLayout, Vec<(u64, u64, u64)>);

/// A command buffer being recorded. Not submitted, it is thrown away.
pub struct Recorder {
    device: Arc<DeviceShared>,
    /// Null where the command buffer is somebody else's.
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    descriptor_pools: Vec<vk::DescriptorPool>,
    sets_left: u32,
    sets: HashMap<SetKey, vk::DescriptorSet>,
    keep: Vec<Keep>,
    queries: vk::QueryPool,
    fence: vk::Fence,
    passes: Vec<TimedPass>,
    is_in_pass: bool,
    times_parts: bool,
    tracker: Option<HazardTracker>,
    error: Option<Error>,
}

impl Recorder {
    fn around(device: Arc<DeviceShared>, pool: vk::CommandPool, commands: vk::CommandBuffer) -> Self {
        Self {
            tracker: device.checks_hazards.then(HazardTracker::default),
            device,
            pool,
            commands,
            descriptor_pools: Vec::new(),
            sets_left: 0,
            sets: HashMap::new(),
            keep: Vec::new(),
            queries: vk::QueryPool::null(),
            fence: vk::Fence::null(),
            passes: Vec::new(),
            is_in_pass: false,
            times_parts: false,
            error: None,
        }
    }

    /// Starts recording.
    ///
    /// Errors: the context has borrowed its device ([`Context::borrowed`]), so it has no queue to submit to.
    pub fn new(ctx: &Context) -> Result<Self> {
        let device = ctx.shared().clone();
        if device.own.is_none() {
            return Err(Error::input(
                "context",
                "its device is borrowed, so it has no queue to submit to",
                "record into a command buffer of the device's owner: Recorder::borrowed",
            ));
        }
        let error = |operation| move |result| Error::Vulkan { operation, object: "recorder".into(), result };
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(device.queue_family);
        // SAFETY: the device is alive; what fails later is destroyed by `Drop`.
        let pool = unsafe { device.raw.create_command_pool(&info, None) }.map_err(error("vkCreateCommandPool"))?;
        let mut recorder = Self::around(device, pool, vk::CommandBuffer::null());
        let raw = &recorder.device.raw;
        let info = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the pool was just made; the command buffer is fresh.
        unsafe {
            recorder.commands = raw.allocate_command_buffers(&info).map_err(error("vkAllocateCommandBuffers"))?[0];
            raw.begin_command_buffer(recorder.commands, &begin).map_err(error("vkBeginCommandBuffer"))?;
        }
        Ok(recorder)
    }

    /// Records into a command buffer of the caller's, behind what it holds already; the caller ends and submits it.
    /// To be closed by [`Recorder::finish`].
    ///
    /// Changes the compute bind point's pipeline, its descriptor set 0 and the push constants of the compute stage.
    /// Barriers are recorded where a pass says so; what the caller must order is documented there.
    ///
    /// # Safety
    /// - `commands` is a command buffer of the context's device and of a queue family with compute, it is recording,
    ///   outside of a render pass, and nothing else records into it as long as the recorder lives.
    /// - The recorder, and later what `finish` returns, is kept until the device is done with every submission of
    ///   `commands`, or until `commands` has been reset or freed unsubmitted.
    pub unsafe fn borrowed(ctx: &Context, commands: vk::CommandBuffer) -> Self {
        Self::around(ctx.shared().clone(), vk::CommandPool::null(), commands)
    }

    /// Ends what was recorded into a borrowed command buffer. What is returned keeps alive what the commands use.
    ///
    /// Errors: what Vulkan refused while recording; the command buffer must not be submitted then.
    pub fn finish(mut self) -> Result<Recorded> {
        assert!(self.pool == vk::CommandPool::null(), "commands of one's own are submitted, not finished");
        self.check()?;
        Ok(Recorded { _recorder: self })
    }

    /// What went wrong while recording. Hazards go to the context's messages.
    fn check(&mut self) -> Result<()> {
        assert!(!self.is_in_pass, "a pass is still open");
        if let Some(error) = self.error.take() {
            return Err(error);
        }
        for hazard in self.tracker.iter_mut().flat_map(HazardTracker::take_hazards) {
            self.device.report(Severity::Error, "TYNDALL-HAZARD", &hazard.to_string());
        }
        Ok(())
    }

    /// Opens a timed, labelled pass. Passes do not nest.
    pub fn begin_pass(&mut self, name: &'static str, iteration: u32) {
        assert!(!self.is_in_pass, "pass '{name}' opened inside another");
        self.is_in_pass = true;
        self.label(Some(name));
        if self.device.has_timestamps && self.queries == vk::QueryPool::null() {
            let info =
                vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(2 * MAX_PASSES);
            // SAFETY: the device is alive.
            match unsafe { self.device.raw.create_query_pool(&info, None) } {
                Ok(queries) => {
                    self.queries = queries;
                    // SAFETY: the command buffer is recording.
                    unsafe { self.device.raw.cmd_reset_query_pool(self.commands, queries, 0, 2 * MAX_PASSES) };
                }
                Err(result) => self.fail("vkCreateQueryPool", name, result),
            }
        }
        self.timestamp(2 * self.passes.len() as u32);
        self.passes.push(TimedPass { name, iteration, dispatches: 0, ms: 0.0 });
    }

    /// Closes the pass.
    pub fn end_pass(&mut self) {
        assert!(self.is_in_pass, "no pass is open");
        self.is_in_pass = false;
        self.timestamp(2 * self.passes.len() as u32 - 1);
        self.label(None);
    }

    /// From here on, [`Recorder::part`] splits passes.
    pub fn time_parts(&mut self) {
        self.times_parts = true;
    }

    /// What follows in the open pass is its part `name`: a pass of its own where parts are timed, else the same pass.
    pub fn part(&mut self, name: &'static str) {
        if self.times_parts && self.is_in_pass {
            let iteration = self.passes.last().map_or(0, |pass| pass.iteration);
            self.end_pass();
            self.begin_pass(name, iteration);
        }
    }

    fn timestamp(&mut self, query: u32) {
        if self.queries != vk::QueryPool::null() && query < 2 * MAX_PASSES {
            // What is before has ended.
            let stage = vk::PipelineStageFlags2::BOTTOM_OF_PIPE;
            // SAFETY: the query was reset above and is written once.
            unsafe { self.device.raw.cmd_write_timestamp2(self.commands, stage, self.queries, query) };
        }
    }

    fn label(&self, name: Option<&str>) {
        if let Some(debug) = &self.device.debug {
            // SAFETY: the command buffer is recording; begin and end pair up because passes do.
            unsafe {
                match name {
                    Some(name) => {
                        let name = std::ffi::CString::new(name).unwrap_or_default();
                        let info = vk::DebugUtilsLabelEXT::default().label_name(&name);
                        debug.cmd_begin_debug_utils_label(self.commands, &info);
                    }
                    None => debug.cmd_end_debug_utils_label(self.commands),
                }
            }
        }
    }

    /// Orders everything recorded before with access `from` before everything recorded later with access `to`, and
    /// makes the writes among them visible.
    pub fn barrier(&mut self, from: Access, to: Access) {
        self.barriers(&[(from, to)]);
    }

    /// Several barriers at once: a device waits once for all of them. They do not chain with each other.
    pub fn barriers(&mut self, barriers: &[(Access, Access)]) {
        if self.device.faults.is(Injection::MissingBarrier) {
            return;
        }
        if let Some(tracker) = &mut self.tracker {
            tracker.barriers(barriers);
        }
        let of = |&(from, to): &(Access, Access)| {
            let ((src_stage, src_access), (dst_stage, dst_access)) = (from.to_vk(), to.to_vk());
            vk::MemoryBarrier2::default()
                .src_stage_mask(src_stage)
                .src_access_mask(src_access)
                .dst_stage_mask(dst_stage)
                .dst_access_mask(dst_access)
        };
        let barriers: Vec<_> = barriers.iter().map(of).collect();
        let info = vk::DependencyInfo::default().memory_barriers(&barriers);
        // SAFETY: the command buffer is recording; the barriers outlive the call.
        unsafe { self.device.raw.cmd_pipeline_barrier2(self.commands, &info) };
    }

    /// Runs `groups` workgroups. `binds` names every resource of the shader, in any order; `push` is its
    /// push-constant block (`&()` where it has none). A name or kind that does not fit is a panic.
    pub fn dispatch<P: Pod>(&mut self, pipeline: &Pipeline, binds: &[(&str, Bind<'_>)], push: &P, groups: [u32; 3]) {
        let limit = self.device.limits.max_compute_work_group_count;
        assert!(
            groups.iter().zip(limit).all(|(&g, l)| g <= l),
            "{}: {groups:?} workgroups, but the device takes {limit:?}",
            pipeline.name()
        );
        if groups.contains(&0) {
            return;
        }
        self.dispatch_out_of_bounds(pipeline, binds, bytemuck::bytes_of(push), groups);
        self.prepare(pipeline, binds, bytemuck::bytes_of(push));
        // SAFETY: pipeline, set and push constants are set; the counts are within the limits.
        unsafe { self.device.raw.cmd_dispatch(self.commands, groups[0], groups[1], groups[2]) };
        let faults = &self.device.faults;
        if faults.is(Injection::WriteAfterWrite)
            && pipeline.raw.shader.bindings.iter().any(|b| b.access == BindingAccess::Write)
            && faults.strikes(Injection::WriteAfterWrite)
        {
            self.dispatch(pipeline, binds, push, groups);
        }
    }

    /// Like [`Self::dispatch`], with the workgroup counts read from three words of `args` at element `offset`.
    pub fn dispatch_indirect<P: Pod>(
        &mut self,
        pipeline: &Pipeline,
        binds: &[(&str, Bind<'_>)],
        push: &P,
        args: &Buffer<u32>,
        offset: usize,
    ) {
        assert!(offset + 3 <= args.len(), "{}: indirect arguments beyond '{}'", pipeline.name(), args.name());
        self.prepare(pipeline, binds, bytemuck::bytes_of(push));
        let bytes = args.bytes_of(offset..offset + 3);
        let offset = bytes.start;
        self.track(args.raw.id, args.name(), bytes, Access::IndirectRead, pipeline.name());
        self.keep.push(Keep::Buffer(args.raw.clone()));
        // SAFETY: the arguments lie inside a buffer with INDIRECT usage, at a multiple of 4.
        unsafe { self.device.raw.cmd_dispatch_indirect(self.commands, args.raw.handle, offset) };
    }

    /// Puts in a dispatch that goes before the one given, to write buffers of a word instead of its own, where the device's
    /// fault is this. GPU-assisted validation, under which alone it is, keeps the writes from happening. (Layer 1.3.239 goes by
    /// the size of buffers, not by a descriptor's range.)
    fn dispatch_out_of_bounds(
        &mut self,
        pipeline: &Pipeline,
        binds: &[(&str, Bind<'_>)],
        push: &[u8],
        groups: [u32; 3],
    ) {
        let faults = &self.device.faults;
        if !faults.is(Injection::OutOfBounds) {
            return;
        }
        let access_of = |name: &str| {
            let binding = pipeline.raw.shader.bindings.iter().find(|b| b.name == name);
            binding.map_or(BindingAccess::Read, |b| b.access)
        };
        let is_written = |(name, bind): &(&str, Bind<'_>)| match bind {
            Bind::Buffer(..) => access_of(name) != BindingAccess::Read,
            _ => false,
        };
        let is_large = |bind: &Bind<'_>| matches!(bind, Bind::Buffer(_, range) if range.end - range.start > 64);
        let writes_images = |(name, bind): &(&str, Bind<'_>)| {
            matches!(bind, Bind::Storage(_)) && access_of(name) != BindingAccess::Read
        };
        let fits = binds.iter().any(|b| is_written(b) && is_large(&b.1)) && !binds.iter().any(writes_images);
        if !fits || !faults.strikes(Injection::OutOfBounds) {
            return;
        }
        let Ok(small) = RawBuffer::new(&self.device, "injected", 4, MemoryLocation::GpuOnly).map(Arc::new) else {
            return;
        };
        let swapped: Vec<_> = binds
            .iter()
            .map(|bind| if is_written(bind) { (bind.0, Bind::Buffer(&small, 0..4)) } else { bind.clone() })
            .collect();
        self.prepare(pipeline, &swapped, push);
        // SAFETY: as in `dispatch`; what the kernel writes beyond the buffer the layer leaves out.
        unsafe { self.device.raw.cmd_dispatch(self.commands, groups[0], groups[1], groups[2]) };
    }

    fn prepare(&mut self, pipeline: &Pipeline, binds: &[(&str, Bind<'_>)], push: &[u8]) {
        let shader = pipeline.raw.shader;
        assert_eq!(push.len(), shader.push_bytes as usize, "push constants of {}", shader.name);
        assert_eq!(binds.len(), shader.bindings.len(), "{} resources of {}: {:?}", binds.len(), shader.name, {
            shader.bindings.iter().map(|b| b.name).collect::<Vec<_>>()
        });
        let mut key = Vec::with_capacity(binds.len());
        let mut ordered = Vec::with_capacity(binds.len());
        for binding in shader.bindings {
            let bind = binds.iter().find(|(name, _)| *name == binding.name);
            let bind = &bind.unwrap_or_else(|| panic!("{}: '{}' is not bound", shader.name, binding.name)).1;
            let access = match binding.access {
                BindingAccess::Read => Access::ComputeRead,
                BindingAccess::Write => Access::ComputeWrite,
                BindingAccess::ReadWrite => Access::ComputeReadWrite,
            };
            match (bind, binding.kind) {
                (Bind::Buffer(b, range), BindingKind::StorageBuffer) => {
                    assert!(range.end <= b.bytes && range.start < range.end, "{}: range of '{}'", shader.name, b.name);
                    key.push((b.id, range.start, range.end));
                    self.track(b.id, &b.name, range.clone(), access, shader.name);
                }
                (Bind::Sampled(i, filter), BindingKind::SampledImage) => {
                    key.push((i.id, 1, *filter as u64));
                    self.track(i.id, &i.name, 0..1, access, shader.name);
                }
                (Bind::Storage(i), BindingKind::StorageImage) => {
                    key.push((i.id, 2, 0));
                    self.track(i.id, &i.name, 0..1, access, shader.name);
                }
                _ => panic!("{}: '{}' must be bound as a {:?}", shader.name, binding.name, binding.kind),
            }
            ordered.push((binding, bind));
        }
        let Some(set) = self.descriptor_set(pipeline, (pipeline.raw.set_layout, key), &ordered) else { return };
        let raw = &self.device.raw;
        // SAFETY: all handles are alive and kept until the submission is done; sizes were checked.
        unsafe {
            raw.cmd_bind_pipeline(self.commands, vk::PipelineBindPoint::COMPUTE, pipeline.raw.handle);
            if !shader.bindings.is_empty() {
                let point = vk::PipelineBindPoint::COMPUTE;
                raw.cmd_bind_descriptor_sets(self.commands, point, pipeline.raw.layout, 0, &[set], &[]);
            }
            if !push.is_empty() {
                let stages = vk::ShaderStageFlags::COMPUTE;
                raw.cmd_push_constants(self.commands, pipeline.raw.layout, stages, 0, push);
            }
        }
        if let Some(pass) = self.passes.last_mut()
            && self.is_in_pass
        {
            pass.dispatches += 1;
        }
    }

    /// A set with these contents: an earlier one where there is one, since sets are never changed once written.
    fn descriptor_set(
        &mut self,
        pipeline: &Pipeline,
        key: SetKey,
        binds: &[(&'static crate::shaders::BindingInfo, &Bind<'_>)],
    ) -> Option<vk::DescriptorSet> {
        if let Some(&set) = self.sets.get(&key) {
            return Some(set);
        }
        if self.sets_left == 0 {
            let sizes = [BindingKind::StorageBuffer, BindingKind::StorageImage, BindingKind::SampledImage]
                .map(|kind| vk::DescriptorPoolSize { ty: descriptor_type(kind), descriptor_count: SETS_PER_POOL * 12 });
            let info = vk::DescriptorPoolCreateInfo::default().max_sets(SETS_PER_POOL).pool_sizes(&sizes);
            // SAFETY: the device is alive.
            match unsafe { self.device.raw.create_descriptor_pool(&info, None) } {
                Ok(pool) => self.descriptor_pools.push(pool),
                Err(result) => {
                    self.fail("vkCreateDescriptorPool", pipeline.name(), result);
                    return None;
                }
            }
            self.sets_left = SETS_PER_POOL;
        }
        self.sets_left -= 1;
        let layouts = [pipeline.raw.set_layout];
        let info = vk::DescriptorSetAllocateInfo::default()
            .descriptor_pool(*self.descriptor_pools.last().expect("made above"))
            .set_layouts(&layouts);
        // SAFETY: the pool has room for SETS_PER_POOL sets of up to 12 descriptors of each kind.
        let set = match unsafe { self.device.raw.allocate_descriptor_sets(&info) } {
            Ok(sets) => sets[0],
            Err(result) => {
                self.fail("vkAllocateDescriptorSets", pipeline.name(), result);
                return None;
            }
        };
        let mut buffers = Vec::with_capacity(binds.len());
        let mut images = Vec::with_capacity(binds.len());
        let mut stale = None;
        for (_, bind) in binds {
            match bind {
                Bind::Buffer(b, range) => {
                    let mut descriptor = vk::DescriptorBufferInfo {
                        buffer: b.handle,
                        offset: range.start,
                        range: range.end - range.start,
                    };
                    stale = stale.or(self.inject(b, &mut descriptor));
                    buffers.push([descriptor]);
                }
                Bind::Sampled(i, filter) => images.push([vk::DescriptorImageInfo {
                    sampler: self.device.sampler(*filter),
                    image_view: i.sampled_view(),
                    image_layout: vk::ImageLayout::GENERAL,
                }]),
                Bind::Storage(i) => images.push([vk::DescriptorImageInfo {
                    sampler: vk::Sampler::null(),
                    image_view: i.view,
                    image_layout: vk::ImageLayout::GENERAL,
                }]),
            }
        }
        let (mut buffer, mut image) = (buffers.iter(), images.iter());
        let mut writes = Vec::with_capacity(binds.len());
        for (info, bind) in binds {
            let write = vk::WriteDescriptorSet::default()
                .dst_set(set)
                .dst_binding(info.binding)
                .descriptor_type(descriptor_type(info.kind));
            writes.push(match bind {
                Bind::Buffer(b, _) => {
                    self.keep.push(Keep::Buffer(Arc::clone(b)));
                    write.buffer_info(buffer.next().expect("one per buffer"))
                }
                Bind::Sampled(i, _) | Bind::Storage(i) => {
                    self.keep.push(Keep::Image(Arc::clone(i)));
                    write.image_info(image.next().expect("one per image"))
                }
            });
        }
        // SAFETY: the set is new and unused; every handle is alive and kept.
        unsafe { self.device.raw.update_descriptor_sets(&writes, &[]) };
        drop(stale);
        self.keep.push(Keep::Pipeline(pipeline.raw.clone()));
        self.sets.insert(key, set);
        Some(set)
    }

    /// Puts the device's fault into a descriptor of `buffer`, if it is one of descriptors. What is returned is to be freed when
    /// the descriptor is written.
    fn inject(&self, buffer: &Arc<RawBuffer>, descriptor: &mut vk::DescriptorBufferInfo) -> Option<RawBuffer> {
        let faults = &self.device.faults;
        if faults.strikes(Injection::Leak) {
            std::mem::forget(buffer.clone());
        }
        if !faults.strikes(Injection::StaleDescriptor) {
            return None;
        }
        let stale = RawBuffer::new(&self.device, "injected", descriptor.range, MemoryLocation::GpuOnly).ok()?;
        (descriptor.buffer, descriptor.offset) = (stale.handle, 0);
        Some(stale)
    }

    fn track(&mut self, id: u64, name: &str, range: std::ops::Range<u64>, access: Access, command: &str) {
        if let Some(tracker) = &mut self.tracker {
            tracker.access(id, name, range, access, command);
        }
    }

    fn fail(&mut self, operation: &'static str, object: &str, result: vk::Result) {
        self.error.get_or_insert(Error::Vulkan { operation, object: object.to_owned(), result });
    }

    /// Sets every word of the buffer to `value` ([`Access::TransferWrite`]).
    pub fn fill<T: Pod>(&mut self, buffer: &Buffer<T>, value: u32) {
        self.fill_range(buffer, 0..buffer.bytes() / 4, value);
    }

    /// Sets words `words` (4 bytes each) of the buffer to `value` ([`Access::TransferWrite`]).
    pub fn fill_range<T: Pod>(&mut self, buffer: &Buffer<T>, words: std::ops::Range<u64>, value: u32) {
        let bytes = buffer.range.start + words.start * 4..buffer.range.start + words.end * 4;
        assert!(bytes.end <= buffer.range.end, "fill beyond '{}'", buffer.name());
        if bytes.is_empty() {
            return;
        }
        self.track(buffer.raw.id, buffer.name(), bytes.clone(), Access::TransferWrite, "fill");
        self.keep.push(Keep::Buffer(buffer.raw.clone()));
        let (start, size) = (bytes.start, bytes.end - bytes.start);
        // SAFETY: the range lies inside the buffer and is a multiple of 4.
        unsafe { self.device.raw.cmd_fill_buffer(self.commands, buffer.raw.handle, start, size, value) };
    }

    /// Sets every texel of a float image to zero or every texel of an integer image to 0 ([`Access::TransferWrite`]).
    pub fn clear_image(&mut self, image: &Image) {
        self.track(image.raw.id, image.name(), 0..1, Access::TransferWrite, "clear");
        self.keep.push(Keep::Image(image.raw.clone()));
        let zero = vk::ClearColorValue { uint32: [0; 4] };
        let (handle, layout) = (image.raw.handle, vk::ImageLayout::GENERAL);
        // SAFETY: the image is in GENERAL and has TRANSFER_DST usage; zero bits are zero in every format.
        unsafe {
            self.device.raw.cmd_clear_color_image(self.commands, handle, layout, &zero, &[super::image::WHOLE]);
        }
    }

    /// Copies `len` elements between buffers ([`Access::TransferRead`], [`Access::TransferWrite`]).
    pub fn copy<T: Pod>(&mut self, from: &Buffer<T>, from_at: usize, to: &Buffer<T>, to_at: usize, len: usize) {
        let (source, target) = (from.bytes_of(from_at..from_at + len), to.bytes_of(to_at..to_at + len));
        assert!(
            source.end <= from.range.end && target.end <= to.range.end,
            "copy '{}' to '{}'",
            from.name(),
            to.name()
        );
        self.copy_raw(&from.raw, source.start, &to.raw, target.start, source.end - source.start);
    }

    /// Copies the first words of a buffer ([`Access::TransferRead`]) to the host, and makes them visible to it.
    pub fn copy_to_host(&mut self, from: &Buffer<u32>, to: &HostWords) {
        let bytes = to.raw.bytes.min(from.bytes());
        self.copy_raw(&from.raw, from.range.start, &to.raw, 0, bytes);
        self.host_read(&to.raw);
    }

    pub(super) fn copy_raw(&mut self, from: &Arc<RawBuffer>, from_at: u64, to: &Arc<RawBuffer>, to_at: u64, size: u64) {
        assert!(from_at + size <= from.bytes && to_at + size <= to.bytes, "copy '{}' to '{}'", from.name, to.name);
        if size == 0 {
            return;
        }
        self.track(from.id, &from.name, from_at..from_at + size, Access::TransferRead, "copy");
        self.track(to.id, &to.name, to_at..to_at + size, Access::TransferWrite, "copy");
        self.keep.push(Keep::Buffer(from.clone()));
        self.keep.push(Keep::Buffer(to.clone()));
        let region = vk::BufferCopy { src_offset: from_at, dst_offset: to_at, size };
        // SAFETY: both ranges lie inside their buffers.
        unsafe { self.device.raw.cmd_copy_buffer(self.commands, from.handle, to.handle, &[region]) };
    }

    fn layers(image: &RawImage, layers: std::ops::Range<u32>) -> vk::BufferImageCopy {
        vk::BufferImageCopy {
            buffer_offset: 0,
            buffer_row_length: 0,
            buffer_image_height: 0,
            image_subresource: vk::ImageSubresourceLayers {
                aspect_mask: vk::ImageAspectFlags::COLOR,
                mip_level: 0,
                base_array_layer: 0,
                layer_count: 1,
            },
            image_offset: vk::Offset3D { x: 0, y: 0, z: layers.start as i32 },
            image_extent: vk::Extent3D {
                width: image.extent[0],
                height: image.extent[1],
                depth: layers.end - layers.start,
            },
        }
    }

    pub(super) fn copy_buffer_to_image(&mut self, from: &Arc<RawBuffer>, to: &Arc<RawImage>, z: std::ops::Range<u32>) {
        let region = Self::layers(to, z);
        self.track(from.id, &from.name, 0..from.bytes, Access::TransferRead, "copy");
        self.track(to.id, &to.name, 0..1, Access::TransferWrite, "copy");
        self.keep.push(Keep::Buffer(from.clone()));
        self.keep.push(Keep::Image(to.clone()));
        let layout = vk::ImageLayout::GENERAL;
        // SAFETY: the caller sized the buffer for these layers.
        unsafe {
            self.device.raw.cmd_copy_buffer_to_image(self.commands, from.handle, to.handle, layout, &[region]);
        }
    }

    pub(super) fn copy_image_to_buffer(&mut self, from: &Arc<RawImage>, to: &Arc<RawBuffer>, z: std::ops::Range<u32>) {
        let region = Self::layers(from, z);
        self.track(from.id, &from.name, 0..1, Access::TransferRead, "copy");
        self.track(to.id, &to.name, 0..to.bytes, Access::TransferWrite, "copy");
        self.keep.push(Keep::Image(from.clone()));
        self.keep.push(Keep::Buffer(to.clone()));
        let layout = vk::ImageLayout::GENERAL;
        // SAFETY: the caller sized the buffer for these layers.
        unsafe {
            self.device.raw.cmd_copy_image_to_buffer(self.commands, from.handle, layout, to.handle, &[region]);
        }
    }

    /// Makes a copy's result visible to the host.
    pub(super) fn host_read(&mut self, buffer: &Arc<RawBuffer>) {
        self.barrier(Access::TransferWrite, Access::HostRead);
        self.track(buffer.id, &buffer.name, 0..buffer.bytes, Access::HostRead, "host read");
    }

    pub(super) fn init_image(&mut self, image: &Arc<RawImage>) {
        self.keep.push(Keep::Image(image.clone()));
        let barriers = [init_barrier(image.handle)];
        let info = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        // SAFETY: the image is new; nothing uses it yet.
        unsafe { self.device.raw.cmd_pipeline_barrier2(self.commands, &info) };
    }

    /// Hands the commands to the device. They start after everything submitted before has finished: the wait on the
    /// timeline orders all memory accesses, so no barrier is needed across submissions.
    pub fn submit(mut self) -> Result<Submission> {
        self.check()?;
        if self.device.faults.have_struck(Injection::StaleDescriptor) {
            let problem = "its descriptor is stale, as was asked for".into();
            return Err(Error::Device { pass: "injection", problem });
        }
        let error = |operation| move |result| submission_error(operation, result);
        let device = self.device.clone();
        let own = device.own.as_ref().expect("a borrowed command buffer is submitted by its owner");
        let queue = own.queue.lock().unwrap_or_else(|e| e.into_inner());
        // SAFETY: the command buffer is recording.
        unsafe { device.raw.end_command_buffer(self.commands) }.map_err(error("vkEndCommandBuffer"))?;
        let before = own.timeline_value.load(Ordering::Relaxed);
        let semaphore =
            |value| vk::SemaphoreSubmitInfo::default().semaphore(own.timeline).value(value).stage_mask(ALL_STAGES);
        let (waits, signals) = ([semaphore(before)], [semaphore(before + 1)]);
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(self.commands)];
        let submits = [vk::SubmitInfo2::default()
            .wait_semaphore_infos(&waits)
            .signal_semaphore_infos(&signals)
            .command_buffer_infos(&commands)];
        // SAFETY: the queue is locked; everything the commands use is kept by `self`, which the submission owns.
        unsafe {
            // The timeline orders submissions; the host waits on a fence, because layer 1.3.239 under GPU-assisted
            // validation never sees a timeline semaphore progress (UNASSIGNED-VkSemaphore-state-timeout).
            self.fence =
                device.raw.create_fence(&vk::FenceCreateInfo::default(), None).map_err(error("vkCreateFence"))?;
            device.raw.queue_submit2(*queue, &submits, self.fence).map_err(error("vkQueueSubmit2"))?;
        }
        own.timeline_value.store(before + 1, Ordering::Relaxed);
        drop(queue);
        Ok(Submission { recorder: self, is_done: false })
    }

    /// Submits and waits.
    pub fn submit_and_wait(self) -> Result<Vec<TimedPass>> {
        self.submit()?.wait()
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // SAFETY: the commands were never submitted, or the submission that owns us has waited for them, or their owner
        // has, who promised so to `borrowed`. Null handles are ignored.
        unsafe {
            for &pool in &self.descriptor_pools {
                self.device.raw.destroy_descriptor_pool(pool, None);
            }
            self.device.raw.destroy_query_pool(self.queries, None);
            self.device.raw.destroy_fence(self.fence, None);
            self.device.raw.destroy_command_pool(self.pool, None);
        }
    }
}

/// Commands in a borrowed command buffer: keeps alive what they use. See [`Recorder::borrowed`] for how long to keep it.
#[must_use = "what the commands use must outlive them"]
pub struct Recorded {
    _recorder: Recorder,
}

/// Commands on their way through the device.
#[must_use = "dropping a submission waits for it"]
pub struct Submission {
    recorder: Recorder,
    is_done: bool,
}

impl Submission {
    /// Waits until the commands are done and returns the times of their passes.
    pub fn wait(mut self) -> Result<Vec<TimedPass>> {
        self.finish()?;
        let recorder = &mut self.recorder;
        let mut passes = std::mem::take(&mut recorder.passes);
        let timed = passes.len().min(MAX_PASSES as usize);
        if recorder.queries != vk::QueryPool::null() && timed > 0 {
            let mut ticks = vec![0u64; 2 * timed];
            let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
            // SAFETY: these queries were written by commands that are done.
            unsafe { recorder.device.raw.get_query_pool_results(recorder.queries, 0, &mut ticks, flags) }.map_err(
                |result| Error::Vulkan { operation: "vkGetQueryPoolResults", object: "timestamps".into(), result },
            )?;
            let period = f64::from(recorder.device.limits.timestamp_period);
            for (pass, t) in passes.iter_mut().zip(ticks.chunks(2)) {
                pass.ms = t[1].saturating_sub(t[0]) as f64 * period * 1e-6;
            }
        }
        Ok(passes)
    }

    fn finish(&mut self) -> Result<()> {
        if self.is_done {
            return Ok(());
        }
        // Also after an error: there is nothing better to wait for.
        self.is_done = true;
        let device = &self.recorder.device;
        // SAFETY: the fence is alive and was handed to the queue.
        let mut result = unsafe { device.raw.wait_for_fences(&[self.recorder.fence], true, TIMEOUT.as_nanos() as u64) };
        if device.is_gpu_assisted && result.is_ok() {
            // Layer 1.4.309 reads its findings only after it has released the waiting fence; what is destroyed before
            // takes them along. Idle waits come after.
            let own = device.own.as_ref().expect("something was submitted");
            let _queue = own.queue.lock().unwrap_or_else(|e| e.into_inner());
            // SAFETY: the device is alive; the lock keeps other threads off the queue.
            result = unsafe { device.raw.device_wait_idle() };
        }
        if device.faults.is(Injection::DeviceLoss) && device.faults.count() > Injection::SUBMISSIONS_BEFORE_LOSS {
            result = Err(vk::Result::ERROR_DEVICE_LOST);
        }
        result.map_err(|result| submission_error("vkWaitForFences", result))
    }
}

/// What a refusal of a submission, or of the wait for it, means.
fn submission_error(operation: &'static str, result: vk::Result) -> Error {
    match result {
        vk::Result::TIMEOUT => {
            Error::DeviceGone { problem: format!("has not done what it was given within {} s", TIMEOUT.as_secs()) }
        }
        vk::Result::ERROR_DEVICE_LOST => Error::DeviceGone { problem: "was lost (VK_ERROR_DEVICE_LOST)".into() },
        result => Error::Vulkan { operation, object: "submission".into(), result },
    }
}

impl Drop for Submission {
    fn drop(&mut self) {
        if let Err(error) = self.finish() {
            self.recorder.device.report(Severity::Error, "TYNDALL-DEVICE", &error.to_string());
        }
    }
}
