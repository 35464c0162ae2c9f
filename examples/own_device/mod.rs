//! A Vulkan device, buffers and command buffers by plain ash, as a program of its own has them. Of Tyndall it needs only
//! [`enable_features`], which could be written out as well.
#![allow(unsafe_code, reason = "a program that talks to Vulkan itself")]
#![allow(missing_docs, reason = "the fields are Vulkan's")]
#![allow(dead_code, reason = "examples and tests each use a part of it")]

use ash::vk;
use std::ffi::{CStr, c_void};
use std::sync::{Arc, Mutex};
use tyndall::primitives::{BorrowedDevice, Buffer, Context, Recorder, enable_features};

/// An instance, a device and a queue with compute.
pub struct OwnDevice {
    pub instance: ash::Instance,
    pub physical: vk::PhysicalDevice,
    pub device: ash::Device,
    pub queue_family: u32,
    pub queue: vk::Queue,
    pool: vk::CommandPool,
    messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    messages: Arc<Mutex<Vec<String>>>,
    // Function pointers die with the entry: it goes last.
    _entry: ash::Entry,
}

/// A buffer in memory that the host sees too.
pub struct OwnBuffer {
    pub handle: vk::Buffer,
    pub bytes: u64,
    memory: vk::DeviceMemory,
    mapped: *mut u32,
    device: ash::Device,
}

unsafe extern "system" fn keep_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _types: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    messages: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the messages outlive the instance; the layer's data are valid during the call, the text ends with a zero.
    let (messages, text) =
        unsafe { (&*messages.cast::<Mutex<Vec<String>>>(), CStr::from_ptr((*data).p_message).to_string_lossy()) };
    messages.lock().unwrap_or_else(|e| e.into_inner()).push(text.into_owned());
    vk::FALSE
}

impl OwnDevice {
    /// The first device that has a queue with compute; `checks`: under core validation and these checks.
    pub fn new(checks: Option<vk::ValidationFeatureEnableEXT>) -> Self {
        let messages = Arc::<Mutex<Vec<String>>>::default();
        let user_data = std::ptr::from_ref(&*messages).cast_mut().cast();
        let messenger_info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
            )
            .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION | vk::DebugUtilsMessageTypeFlagsEXT::GENERAL)
            .pfn_user_callback(Some(keep_message))
            .user_data(user_data);
        let enables = [checks.unwrap_or_default(), vk::ValidationFeatureEnableEXT::GPU_ASSISTED_RESERVE_BINDING_SLOT];
        let is_gpu_assisted = checks == Some(vk::ValidationFeatureEnableEXT::GPU_ASSISTED);
        let mut features = vk::ValidationFeaturesEXT::default()
            .enabled_validation_features(&enables[..1 + usize::from(is_gpu_assisted)]);
        let layers = [c"VK_LAYER_KHRONOS_validation".as_ptr()];
        let extensions = [ash::ext::debug_utils::NAME.as_ptr(), ash::ext::validation_features::NAME.as_ptr()];
        // Chained to the instance too, so that its making and its end are covered.
        let mut chained = messenger_info;
        let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_3);
        let mut info = vk::InstanceCreateInfo::default().application_info(&application);
        if checks.is_some() {
            info = info
                .enabled_layer_names(&layers)
                .enabled_extension_names(&extensions)
                .push_next(&mut features)
                .push_next(&mut chained);
        }
        // SAFETY: everything that the infos point to outlives the calls; handles are used on what made them.
        unsafe {
            let entry = ash::Entry::load().expect("a Vulkan loader");
            let instance = entry.create_instance(&info, None).expect("an instance (and the layer, to validate)");
            let messenger = checks.map(|_| {
                let functions = ash::ext::debug_utils::Instance::new(&entry, &instance);
                let made = functions.create_debug_utils_messenger(&messenger_info, None).expect("a messenger");
                (functions, made)
            });
            let devices = instance.enumerate_physical_devices().expect("the list of devices");
            let compute = |&device: &vk::PhysicalDevice| {
                let families = instance.get_physical_device_queue_family_properties(device);
                let family = families.iter().position(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE))?;
                Some((device, family as u32))
            };
            let (physical, queue_family) = devices.iter().find_map(compute).expect("a device that computes");
            let queues =
                [vk::DeviceQueueCreateInfo::default().queue_family_index(queue_family).queue_priorities(&[1.0])];
            let (mut f12, mut f13) = Default::default();
            enable_features(&mut f12, &mut f13);
            // The checks on the GPU write what they find from the shaders.
            let core = vk::PhysicalDeviceFeatures::default()
                .fragment_stores_and_atomics(is_gpu_assisted)
                .vertex_pipeline_stores_and_atomics(is_gpu_assisted);
            let info = vk::DeviceCreateInfo::default()
                .queue_create_infos(&queues)
                .enabled_features(&core)
                .push_next(&mut f12)
                .push_next(&mut f13);
            let device = instance.create_device(physical, &info, None).expect("a device with the features");
            let info = vk::CommandPoolCreateInfo::default().queue_family_index(queue_family);
            let pool = device.create_command_pool(&info, None).expect("a command pool");
            let queue = device.get_device_queue(queue_family, 0);
            Self { instance, physical, device, queue_family, queue, pool, messenger, messages, _entry: entry }
        }
    }

    /// A buffer of so many words.
    pub fn buffer(&self, words: usize) -> OwnBuffer {
        use vk::BufferUsageFlags as Usage;
        use vk::MemoryPropertyFlags as Property;
        let bytes = 4 * words as u64;
        let usage = Usage::STORAGE_BUFFER | Usage::TRANSFER_SRC | Usage::TRANSFER_DST | Usage::INDIRECT_BUFFER;
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage);
        // SAFETY: as above; the memory is mapped as long as it lives.
        unsafe {
            let handle = self.device.create_buffer(&info, None).expect("a buffer");
            let needs = self.device.get_buffer_memory_requirements(handle);
            let kinds = self.instance.get_physical_device_memory_properties(self.physical);
            let wanted = Property::HOST_VISIBLE | Property::HOST_COHERENT;
            let kind = (0..kinds.memory_type_count)
                .find(|&i| {
                    needs.memory_type_bits >> i & 1 == 1
                        && kinds.memory_types[i as usize].property_flags.contains(wanted)
                })
                .expect("Vulkan promises such memory");
            let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(kind);
            let memory = self.device.allocate_memory(&info, None).expect("memory");
            self.device.bind_buffer_memory(handle, memory, 0).expect("memory that fits");
            let mapped = self.device.map_memory(memory, 0, vk::WHOLE_SIZE, Default::default()).expect("mapped memory");
            OwnBuffer { handle, bytes, memory, mapped: mapped.cast(), device: self.device.clone() }
        }
    }

    /// A command buffer that is recording.
    pub fn begin(&self) -> vk::CommandBuffer {
        let info = vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
        // SAFETY: as above.
        unsafe {
            let commands = self.device.allocate_command_buffers(&info).expect("a command buffer")[0];
            self.device.begin_command_buffer(commands, &Default::default()).expect("to begin");
            commands
        }
    }

    /// A global memory barrier.
    pub fn barrier(
        &self,
        commands: vk::CommandBuffer,
        from: (vk::PipelineStageFlags2, vk::AccessFlags2),
        to: (vk::PipelineStageFlags2, vk::AccessFlags2),
    ) {
        let barriers = [vk::MemoryBarrier2::default()
            .src_stage_mask(from.0)
            .src_access_mask(from.1)
            .dst_stage_mask(to.0)
            .dst_access_mask(to.1)];
        let info = vk::DependencyInfo::default().memory_barriers(&barriers);
        // SAFETY: the command buffer is recording.
        unsafe { self.device.cmd_pipeline_barrier2(commands, &info) };
    }

    /// Copies `bytes` bytes between buffers.
    pub fn copy(&self, commands: vk::CommandBuffer, from: &OwnBuffer, to: &OwnBuffer, bytes: u64) {
        let region = vk::BufferCopy { src_offset: 0, dst_offset: 0, size: bytes };
        // SAFETY: the command buffer is recording, both buffers are alive; the layer checks the range.
        unsafe { self.device.cmd_copy_buffer(commands, from.handle, to.handle, &[region]) };
    }

    /// Ends the command buffer where it is still recording.
    pub fn end(&self, commands: vk::CommandBuffer) {
        // SAFETY: it is recording.
        unsafe { self.device.end_command_buffer(commands) }.expect("to end");
    }

    /// Submits the command buffer, which has been ended, and waits until it is done.
    pub fn submit_and_wait(&self, commands: vk::CommandBuffer) {
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(commands)];
        let submits = [vk::SubmitInfo2::default().command_buffer_infos(&commands)];
        // SAFETY: one thread submits; the fence is destroyed when it is signalled.
        unsafe {
            let fence = self.device.create_fence(&Default::default(), None).expect("a fence");
            self.device.queue_submit2(self.queue, &submits, fence).expect("to submit");
            self.device.wait_for_fences(&[fence], true, 60_000_000_000).expect("the work done in a minute");
            self.device.destroy_fence(fence, None);
        }
    }

    /// What the validation layer has said so far.
    pub fn messages(&self) -> Vec<String> {
        self.messages.lock().unwrap_or_else(|e| e.into_inner()).clone()
    }

    /// Destroys everything; returns what the layer has said, the end included.
    pub fn close(self) -> Vec<String> {
        let messages = self.messages.clone();
        drop(self);
        std::mem::take(&mut *messages.lock().unwrap_or_else(|e| e.into_inner()))
    }

    /// This device as Tyndall's context. It must go before `self`.
    pub fn context(&self) -> tyndall::Result<Context> {
        let borrowed = BorrowedDevice {
            instance: &self.instance,
            physical: self.physical,
            device: &self.device,
            queue_family: self.queue_family,
            cache_dir: None,
        };
        // SAFETY: the handles are this device's, the features are on.
        unsafe { Context::borrowed(&borrowed) }
    }

    /// A recorder around a command buffer. What it makes must be kept until the commands are done.
    pub fn recorder(&self, ctx: &Context, commands: vk::CommandBuffer) -> Recorder {
        // SAFETY: a recording command buffer of this device.
        unsafe { Recorder::borrowed(ctx, commands) }
    }
}

impl Drop for OwnDevice {
    fn drop(&mut self) {
        // SAFETY: all submissions were waited for; buffers and contexts have gone before.
        unsafe {
            self.device.destroy_command_pool(self.pool, None);
            self.device.destroy_device(None);
            if let Some((functions, messenger)) = self.messenger.take() {
                functions.destroy_debug_utils_messenger(messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}

impl OwnBuffer {
    fn words(&self) -> usize {
        self.bytes as usize / 4
    }

    /// Sets the words from word `at` on. The device must not be using them.
    pub fn write(&self, at: usize, words: &[u32]) {
        assert!(at + words.len() <= self.words());
        // SAFETY: inside the mapping, which is aligned for words.
        unsafe { self.mapped.add(at).copy_from_nonoverlapping(words.as_ptr(), words.len()) };
    }

    /// All words. The device must be done with them, and have made them available to the host.
    pub fn read(&self) -> Vec<u32> {
        // SAFETY: the whole mapping, which was written as zeroed memory, by `write` or by the device.
        unsafe { std::slice::from_raw_parts(self.mapped, self.words()) }.to_vec()
    }

    /// A part of it, in bytes, as Tyndall's buffer.
    pub fn part<T: bytemuck::Pod>(&self, ctx: &Context, offset: u64, bytes: u64) -> tyndall::Result<Buffer<T>> {
        assert!(offset + bytes <= self.bytes);
        // SAFETY: it has the usages and lies inside the buffer. Tests keep it as long as it is used.
        unsafe { Buffer::borrowed(ctx, "own", self.handle, offset, bytes) }
    }
}

impl Drop for OwnBuffer {
    fn drop(&mut self) {
        // SAFETY: all submissions were waited for.
        unsafe {
            self.device.destroy_buffer(self.handle, None);
            self.device.free_memory(self.memory, None);
        }
    }
}
