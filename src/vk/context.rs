//! Instance, device, queue, allocator: made together, torn down in the reverse order.

use super::buffer::{Buffer, Filter, RawBuffer};
use super::image::{Image, ImageFormat, RawImage};
use super::injection::{Faults, Injection};
use super::pipeline::{KernelForm, PipelineStore};
use super::pipeline_cache::CacheFile;
use super::recorder::{Recorder, Submission};
use super::statistics::{self, KernelStatistics};
use super::validation::{self, LayerSettings, Message, Severity, Sink, Validation};
use crate::shaders::constants;
use crate::{Error, Result};
use ash::vk;
use bytemuck::Pod;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationSizes, AllocatorDebugSettings, MemoryLocation};
use std::ffi::CStr;
use std::marker::PhantomData;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};

/// Bytes of one staging copy.
const STAGING_BYTES: usize = 32 << 20;

/// How to make a context.
#[derive(Clone, Debug, Default)]
pub struct ContextConfig {
    /// Index in the list of devices, or part of a device's name. `None`: the fastest kind there is.
    pub device: Option<String>,
    /// Checks that run along.
    pub validation: Validation,
    /// Folder for compiled pipelines (see [`super::user_cache_dir`]); `None`: they are compiled anew.
    pub cache_dir: Option<PathBuf>,
    /// Whether to ask the driver about the kernels that it compiles.
    pub kernel_statistics: bool,
    /// A fault to put into what is recorded.
    pub injection: Option<Injection>,
    /// Use no more than so many bytes of device memory.
    pub memory_limit: Option<u64>,
    /// Whether workgroups that have started go on running, whatever others do, where that is better known than by the driver.
    pub forward_progress: Option<bool>,
}

/// A device as `tyndall devices` shows it.
#[derive(Clone, Debug)]
pub struct DeviceInfo {
    /// Name as the driver reports it.
    pub name: String,
    /// Driver name and version.
    pub driver: String,
    /// Which driver it is; 0 where the device does not say.
    pub driver_id: vk::DriverId,
    /// "discrete GPU", "integrated GPU", "virtual GPU", "CPU" or "other".
    pub kind: &'static str,
    /// Vulkan version of the device.
    pub api_version: String,
    /// Invocations of a subgroup.
    pub subgroup_size: u32,
    /// Limits that matter here, by their Vulkan names.
    pub limits: Vec<(&'static str, u64)>,
    /// Features, extensions and limits that Tyndall needs and the device lacks.
    pub missing: Vec<String>,
}

/// How pipelines came about.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct PipelineStats {
    /// Pipelines made.
    pub made: u32,
    /// Those of them that the driver took from the cache on disk.
    pub cached: u32,
    /// Time that making them took, in milliseconds.
    pub ms: f64,
}

/// A device that the caller has made and keeps; see [`Context::borrowed`].
pub struct BorrowedDevice<'a> {
    /// Its instance.
    pub instance: &'a ash::Instance,
    /// What it was made of.
    pub physical: vk::PhysicalDevice,
    /// The device.
    pub device: &'a ash::Device,
    /// Family of the queue that command buffers will be submitted to.
    pub queue_family: u32,
    /// Folder for compiled pipelines (see [`super::user_cache_dir`]); `None`: they are compiled anew.
    pub cache_dir: Option<PathBuf>,
}

/// What a context has that made its device itself.
pub(super) struct Own {
    pub(super) queue: Mutex<vk::Queue>,
    pub(super) timeline: vk::Semaphore,
    pub(super) timeline_value: AtomicU64,
    samplers: [vk::Sampler; 2],
    messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    instance: ash::Instance,
    // Function pointers die with the entry: it goes last.
    entry: ash::Entry,
}

/// What every Vulkan object holds on to.
pub(super) struct DeviceShared {
    // Dropped by hand in `drop`, in the order that Vulkan asks for.
    pub(super) raw: ash::Device,
    allocator: Mutex<Option<Allocator>>,
    /// `None` where the device is borrowed.
    pub(super) own: Option<Own>,
    pub(super) queue_family: u32,
    pub(super) pipeline_cache: vk::PipelineCache,
    cache_file: Option<CacheFile>,
    pipelines: Mutex<PipelineStats>,
    /// Where statistics of kernels are asked for and to be had.
    pub(super) executables: Option<ash::khr::pipeline_executable_properties::Device>,
    pub(super) kernels: Mutex<Vec<KernelStatistics>>,
    pub(super) limits: vk::PhysicalDeviceLimits,
    vendor_id: u32,
    min_subgroup_size: u32,
    pub(super) max_subgroup_size: u32,
    field_formats: Vec<ImageFormat>,
    pub(super) has_timestamps: bool,
    pub(super) debug: Option<ash::ext::debug_utils::Device>,
    pub(super) checks_hazards: bool,
    pub(super) is_gpu_assisted: bool,
    pub(super) faults: Faults,
    pub(super) sink: Arc<Sink>,
    max_allocation: u64,
    /// Bytes of memory, and whether they are fewer than the device has.
    memory: u64,
    is_memory_limited: bool,
    bytes_now: AtomicU64,
    bytes_peak: AtomicU64,
    ids: AtomicU64,
}

impl DeviceShared {
    fn allocator(&self) -> MutexGuard<'_, Option<Allocator>> {
        self.allocator.lock().unwrap_or_else(|e| e.into_inner())
    }

    pub(super) fn allocate(&self, desc: &AllocationCreateDesc<'_>) -> Result<Allocation> {
        let size = desc.requirements.size;
        let cure = "use a smaller volume or picture, or a device with more memory";
        if size > self.max_allocation {
            return Err(Error::DeviceMemory {
                object: desc.name.to_owned(),
                needed: size,
                limit: self.max_allocation,
                limit_name: "maxMemoryAllocationSize",
                cure: cure.into(),
            });
        }
        let used = self.bytes_now.load(Ordering::Relaxed);
        let none_left = || Error::OutOfDeviceMemory {
            object: desc.name.to_owned(),
            needed: size,
            used,
            total: self.memory,
            cure: cure.into(),
        };
        if self.is_memory_limited && used + size > self.memory {
            return Err(none_left());
        }
        let mut allocator = self.allocator();
        let allocator = allocator.as_mut().expect("the allocator lives as long as the device");
        let allocation = allocator.allocate(desc).map_err(|error| match error {
            gpu_allocator::AllocationError::OutOfMemory => none_left(),
            other => Error::Device { pass: "memory allocation", problem: format!("'{}': {other}", desc.name) },
        })?;
        let now = self.bytes_now.fetch_add(allocation.size(), Ordering::Relaxed) + allocation.size();
        self.bytes_peak.fetch_max(now, Ordering::Relaxed);
        Ok(allocation)
    }

    pub(super) fn free(&self, allocation: Allocation) {
        self.bytes_now.fetch_sub(allocation.size(), Ordering::Relaxed);
        if let Some(allocator) = self.allocator().as_mut()
            && let Err(error) = allocator.free(allocation)
        {
            self.report(Severity::Error, "TYNDALL-FREE", &error.to_string());
        }
    }

    pub(super) fn sampler(&self, filter: Filter) -> vk::Sampler {
        let own = self.own.as_ref().expect("there are no images on a borrowed device");
        own.samplers[(filter == Filter::Linear) as usize]
    }

    pub(super) fn next_id(&self) -> u64 {
        self.ids.fetch_add(1, Ordering::Relaxed)
    }

    pub(super) fn set_name<H: vk::Handle>(&self, handle: H, name: &str) {
        if let Some(debug) = &self.debug {
            let name = std::ffi::CString::new(name).unwrap_or_default();
            let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(handle).object_name(&name);
            // SAFETY: the handle is a live object of this device. A failure costs only the name.
            let _ = unsafe { debug.set_debug_utils_object_name(&info) };
        }
    }

    pub(super) fn report(&self, severity: Severity, id: &str, text: &str) {
        self.sink.push(Message { severity, id: id.to_owned(), text: text.to_owned() });
    }
}

impl DeviceShared {
    fn pipelines(&self) -> MutexGuard<'_, PipelineStats> {
        self.pipelines.lock().unwrap_or_else(|e| e.into_inner())
    }

    pub(super) fn count_pipeline(&self, is_cached: bool, ms: f64) {
        let mut stats = self.pipelines();
        stats.made += 1;
        stats.cached += u32::from(is_cached);
        stats.ms += ms;
    }

    /// Keeps compiled pipelines for the next time, if there are new ones.
    fn write_cache(&self) {
        let Some(file) = &self.cache_file else { return };
        let stats = *self.pipelines();
        if stats.made == stats.cached {
            return;
        }
        // SAFETY: device and cache are alive, and nothing else uses the cache.
        match unsafe { self.raw.get_pipeline_cache_data(self.pipeline_cache) } {
            Ok(data) => file.write(&data),
            Err(result) => log::debug!("vkGetPipelineCacheData: {result}"),
        }
    }
}

impl Drop for DeviceShared {
    fn drop(&mut self) {
        self.write_cache();
        // SAFETY: every object of the device holds an Arc of `self`, so none is left; the queue is idle after the wait.
        // Of a borrowed device only what was made here goes, which its owner has promised to be done with.
        unsafe {
            if self.own.is_some() {
                let _ = self.raw.device_wait_idle();
            }
            self.raw.destroy_pipeline_cache(self.pipeline_cache, None);
            drop(self.allocator().take());
            let Some(own) = self.own.take() else { return };
            for sampler in own.samplers {
                self.raw.destroy_sampler(sampler, None);
            }
            self.raw.destroy_semaphore(own.timeline, None);
            self.raw.destroy_device(None);
            if let Some((functions, messenger)) = own.messenger {
                functions.destroy_debug_utils_messenger(messenger, None);
            }
            own.instance.destroy_instance(None);
        }
    }
}

/// Texels on their way from an image to the host.
#[must_use = "dropping it waits for it"]
pub struct ImageReadBack<T> {
    submission: Submission,
    staging: Arc<RawBuffer>,
    bytes: usize,
    texel: PhantomData<T>,
}

impl<T: Pod> ImageReadBack<T> {
    /// The texels, x fastest.
    pub fn wait(self) -> Result<Vec<T>> {
        self.submission.wait()?;
        Ok(bytemuck::cast_slice(&self.staging.mapped()[..self.bytes]).to_vec())
    }
}

/// A device ready for use.
pub struct Context {
    shared: Arc<DeviceShared>,
    info: DeviceInfo,
    config: ContextConfig,
    pipelines: PipelineStore,
}

struct Instance {
    entry: ash::Entry,
    raw: ash::Instance,
    messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    sink: Arc<Sink>,
}

const INSTALL_DRIVER: &str =
    "install a Vulkan driver: your GPU vendor's, or Mesa's software one (Debian, Ubuntu: mesa-vulkan-drivers)";

fn create_instance(validation: Validation) -> Result<Instance> {
    // SAFETY: loading the system's Vulkan loader runs its initialisers, which is what we want.
    let entry = unsafe { ash::Entry::load() }.map_err(|e| Error::NoDevice {
        problem: format!("the Vulkan loader cannot be loaded ({e})"),
        cure: "install libvulkan1 (Debian, Ubuntu) or your system's Vulkan loader".into(),
    })?;
    let sink = Arc::new(Sink::default());
    let application = vk::ApplicationInfo::default().application_name(c"tyndall").api_version(vk::API_VERSION_1_3);
    let mut info = vk::InstanceCreateInfo::default().application_info(&application);
    let mut extensions = Vec::new();
    let mut layers = Vec::new();

    let mut messenger_info = validation::messenger_info(&sink);
    let mut enables = Vec::new();
    match validation {
        Validation::Off => {}
        Validation::CoreAndSync => enables.push(vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION),
        Validation::BestPractices => enables.push(vk::ValidationFeatureEnableEXT::BEST_PRACTICES),
        Validation::GpuAssisted => {
            enables.push(vk::ValidationFeatureEnableEXT::GPU_ASSISTED);
            enables.push(vk::ValidationFeatureEnableEXT::GPU_ASSISTED_RESERVE_BINDING_SLOT);
        }
    }
    let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&enables);
    let setting = |name: &'static CStr, value: &'static [u32; 1]| {
        vk::LayerSettingEXT::default()
            .layer_name(validation::LAYER)
            .setting_name(name)
            .ty(vk::LayerSettingTypeEXT::BOOL32)
            .values(bytemuck::cast_slice(value))
    };
    const ON: &[u32; 1] = &[vk::TRUE];
    const OFF: &[u32; 1] = &[vk::FALSE];
    // Newer layers see dispatch-to-dispatch hazards only with the shader access heuristic.
    let settings = match validation {
        Validation::Off => vec![],
        Validation::CoreAndSync => vec![
            setting(c"validate_sync", ON),
            setting(c"syncval_submit_time_validation", ON),
            setting(c"syncval_shader_accesses_heuristic", ON),
        ],
        Validation::BestPractices => vec![setting(c"validate_best_practices", ON)],
        // The layer warns when it is asked for core checks beside, and where a device lacks what an enabled check needs.
        Validation::GpuAssisted => vec![
            setting(c"validate_core", OFF),
            setting(c"gpuav_enable", ON),
            setting(c"gpuav_validate_ray_query", OFF),
        ],
    };
    let mut settings_info = vk::LayerSettingsCreateInfoEXT::default().settings(&settings);
    if validation != Validation::Off {
        layers.push(validation::LAYER.as_ptr());
        extensions.push(ash::ext::debug_utils::NAME.as_ptr());
        // Never both: the layer lets the deprecated settings win when they are mixed.
        match validation::find_layer(&entry)? {
            LayerSettings::Settings => {
                extensions.push(ash::ext::layer_settings::NAME.as_ptr());
                info = info.push_next(&mut settings_info);
            }
            LayerSettings::Features => {
                extensions.push(ash::ext::validation_features::NAME.as_ptr());
                info = info.push_next(&mut features);
            }
        }
        info = info.push_next(&mut messenger_info);
    }
    info = info.enabled_extension_names(&extensions).enabled_layer_names(&layers);
    // SAFETY: everything that `info` points to lives until after the call.
    let raw = unsafe { entry.create_instance(&info, None) }.map_err(|result| Error::NoDevice {
        problem: format!("vkCreateInstance failed: {result}"),
        cure: INSTALL_DRIVER.into(),
    })?;
    let messenger = if validation == Validation::Off {
        None
    } else {
        let functions = ash::ext::debug_utils::Instance::new(&entry, &raw);
        let info = validation::messenger_info(&sink);
        // SAFETY: the sink outlives the instance: it is shared by `DeviceShared` and dropped after it.
        let messenger = unsafe { functions.create_debug_utils_messenger(&info, None) }.map_err(|result| {
            Error::Vulkan { operation: "vkCreateDebugUtilsMessengerEXT", object: "messenger".into(), result }
        })?;
        Some((functions, messenger))
    };
    Ok(Instance { entry, raw, messenger, sink })
}

impl Instance {
    fn destroy(self) {
        // SAFETY: no device was made from this instance.
        unsafe {
            if let Some((functions, messenger)) = self.messenger {
                functions.destroy_debug_utils_messenger(messenger, None);
            }
            self.raw.destroy_instance(None);
        }
    }

    fn physical_devices(&self) -> Vec<vk::PhysicalDevice> {
        // SAFETY: the instance is alive.
        let mut devices = unsafe { self.raw.enumerate_physical_devices() }.unwrap_or_default();
        // The fastest kind first; the loader's order within a kind.
        devices.sort_by_key(|&d| {
            // SAFETY: as above.
            match unsafe { self.raw.get_physical_device_properties(d) }.device_type {
                vk::PhysicalDeviceType::DISCRETE_GPU => 0,
                vk::PhysicalDeviceType::INTEGRATED_GPU => 1,
                vk::PhysicalDeviceType::VIRTUAL_GPU => 2,
                vk::PhysicalDeviceType::CPU => 3,
                _ => 4,
            }
        });
        devices
    }
}

/// What was read of a physical device.
struct Probe {
    info: DeviceInfo,
    properties: vk::PhysicalDeviceProperties,
    min_subgroup_size: u32,
    max_subgroup_size: u32,
    field_formats: Vec<ImageFormat>,
    max_allocation: u64,
    queue_family: u32,
    timestamp_bits: u32,
}

/// What is needed of a device.
#[derive(Clone, Copy, PartialEq)]
enum Needs {
    /// All of it.
    Renderer,
    /// What scan, sort and selection use, on a queue of this family.
    Primitives { queue_family: u32 },
}

/// Switches on the features that [`crate::primitives`] needs in what a `VkDeviceCreateInfo` is chained to. Others may be on
/// too. No extension is needed.
pub fn enable_features(
    vulkan_1_2: &mut vk::PhysicalDeviceVulkan12Features<'_>,
    vulkan_1_3: &mut vk::PhysicalDeviceVulkan13Features<'_>,
) {
    vulkan_1_2.scalar_block_layout = vk::TRUE;
    vulkan_1_2.vulkan_memory_model = vk::TRUE;
    vulkan_1_2.vulkan_memory_model_device_scope = vk::TRUE;
    vulkan_1_3.synchronization2 = vk::TRUE;
    vulkan_1_3.subgroup_size_control = vk::TRUE;
    vulkan_1_3.compute_full_subgroups = vk::TRUE;
    vulkan_1_3.maintenance4 = vk::TRUE;
}

/// What fields need of a format.
const OF_FIELDS: vk::FormatFeatureFlags2 = vk::FormatFeatureFlags2::from_raw(
    vk::FormatFeatureFlags2::STORAGE_IMAGE.as_raw() | vk::FormatFeatureFlags2::SAMPLED_IMAGE_FILTER_LINEAR.as_raw(),
);

fn probe(instance: &ash::Instance, device: vk::PhysicalDevice, needs: Needs) -> Probe {
    let mut v11 = vk::PhysicalDeviceVulkan11Properties::default();
    let mut v12 = vk::PhysicalDeviceVulkan12Properties::default();
    let mut v13 = vk::PhysicalDeviceVulkan13Properties::default();
    // SAFETY: the instance is alive.
    let version = unsafe { instance.get_physical_device_properties(device) }.api_version;
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut v11);
    if version >= vk::API_VERSION_1_3 {
        properties = properties.push_next(&mut v12).push_next(&mut v13);
    }
    // SAFETY: the chained structs outlive the call and are known to the device's version.
    unsafe { instance.get_physical_device_properties2(device, &mut properties) };
    let p = properties.properties;
    let mut missing = Vec::new();
    if version < vk::API_VERSION_1_3 {
        missing.push("Vulkan 1.3".to_owned());
    } else {
        let mut f12 = vk::PhysicalDeviceVulkan12Features::default();
        let mut f13 = vk::PhysicalDeviceVulkan13Features::default();
        let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut f12).push_next(&mut f13);
        // SAFETY: as above.
        unsafe { instance.get_physical_device_features2(device, &mut features) };
        for (name, has) in [
            ("timelineSemaphore", if needs == Needs::Renderer { f12.timeline_semaphore } else { vk::TRUE }),
            ("scalarBlockLayout", f12.scalar_block_layout),
            ("vulkanMemoryModel", f12.vulkan_memory_model),
            ("vulkanMemoryModelDeviceScope", f12.vulkan_memory_model_device_scope),
            ("synchronization2", f13.synchronization2),
            ("subgroupSizeControl", f13.subgroup_size_control),
            ("computeFullSubgroups", f13.compute_full_subgroups),
            ("maintenance4", f13.maintenance4),
        ] {
            if has == vk::FALSE {
                missing.push(name.to_owned());
            }
        }
        let needed = vk::SubgroupFeatureFlags::BASIC
            | vk::SubgroupFeatureFlags::ARITHMETIC
            | vk::SubgroupFeatureFlags::BALLOT
            | vk::SubgroupFeatureFlags::SHUFFLE;
        if !v11.subgroup_supported_operations.contains(needed) {
            missing.push("subgroup arithmetic, ballot and shuffle".to_owned());
        }
    }
    let l = p.limits;
    let mut at_least = |name: &str, has: u32, need: u32| {
        if has < need {
            missing.push(format!("{name} ≥ {need} (it has {has})"));
        }
    };
    at_least("maxComputeWorkGroupInvocations", l.max_compute_work_group_invocations, 256);
    at_least("maxComputeSharedMemorySize", l.max_compute_shared_memory_size, constants::SHARED_BYTES);
    at_least("maxPushConstantsSize", l.max_push_constants_size, 128);
    at_least("maxPerStageDescriptorStorageBuffers", l.max_per_stage_descriptor_storage_buffers, 12);
    // SAFETY: as above.
    let families = unsafe { instance.get_physical_device_queue_family_properties(device) };
    let has_compute = |f: &vk::QueueFamilyProperties| f.queue_flags.contains(vk::QueueFlags::COMPUTE);
    let family = match needs {
        Needs::Renderer => families.iter().position(has_compute),
        Needs::Primitives { queue_family } => {
            Some(queue_family as usize).filter(|&f| families.get(f).is_some_and(has_compute))
        }
    };
    if family.is_none() {
        missing.push("a compute queue".to_owned());
    }
    let family = family.unwrap_or(0);
    // SAFETY: as above.
    let features = unsafe { instance.get_physical_device_features(device) };
    let mut field_formats = vec![ImageFormat::Rgba16Float, ImageFormat::Rgba32Float, ImageFormat::Alpha32Float];
    if features.shader_storage_image_extended_formats == vk::TRUE {
        field_formats.extend([ImageFormat::GreyAlpha16Float, ImageFormat::GreyAlpha32Float]);
    }
    let features_of = |format: ImageFormat| {
        let mut f3 = vk::FormatProperties3::default();
        let mut f = vk::FormatProperties2::default().push_next(&mut f3);
        // SAFETY: as above.
        unsafe { instance.get_physical_device_format_properties2(device, format.to_vk(), &mut f) };
        f3.optimal_tiling_features
    };
    let formats = [
        (ImageFormat::R32Float, vk::FormatFeatureFlags2::STORAGE_IMAGE | vk::FormatFeatureFlags2::SAMPLED_IMAGE),
        (ImageFormat::R32Uint, vk::FormatFeatureFlags2::STORAGE_IMAGE | vk::FormatFeatureFlags2::SAMPLED_IMAGE),
        (ImageFormat::Rgba16Float, OF_FIELDS),
    ];
    for (format, needs) in formats.into_iter().filter(|_| needs == Needs::Renderer) {
        if !features_of(format).contains(needs) {
            missing.push(format!("{format:?} images with {needs:?}"));
        }
    }
    let text = |chars: &[std::ffi::c_char]| {
        // SAFETY: Vulkan's fixed strings are zero-terminated.
        unsafe { CStr::from_ptr(chars.as_ptr()) }.to_string_lossy().into_owned()
    };
    let v = p.api_version;
    let info = DeviceInfo {
        name: text(&p.device_name),
        driver: format!("{} {}", text(&v12.driver_name), text(&v12.driver_info)).trim().to_owned(),
        driver_id: v12.driver_id,
        kind: match p.device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => "discrete GPU",
            vk::PhysicalDeviceType::INTEGRATED_GPU => "integrated GPU",
            vk::PhysicalDeviceType::VIRTUAL_GPU => "virtual GPU",
            vk::PhysicalDeviceType::CPU => "CPU",
            _ => "other",
        },
        api_version: format!("{}.{}.{}", vk::api_version_major(v), vk::api_version_minor(v), vk::api_version_patch(v)),
        subgroup_size: v11.subgroup_size,
        limits: vec![
            ("maxStorageBufferRange", l.max_storage_buffer_range.into()),
            ("maxMemoryAllocationSize", v11.max_memory_allocation_size),
            ("maxImageDimension3D", l.max_image_dimension3_d.into()),
            ("maxImageDimension2D", l.max_image_dimension2_d.into()),
            ("maxComputeSharedMemorySize", l.max_compute_shared_memory_size.into()),
            ("maxComputeWorkGroupInvocations", l.max_compute_work_group_invocations.into()),
            ("maxComputeWorkGroupCount[0]", l.max_compute_work_group_count[0].into()),
        ],
        missing,
    };
    Probe {
        info,
        properties: p,
        min_subgroup_size: if v13.min_subgroup_size == 0 { v11.subgroup_size } else { v13.min_subgroup_size },
        field_formats: field_formats.into_iter().filter(|&format| features_of(format).contains(OF_FIELDS)).collect(),
        max_subgroup_size: if v13.max_subgroup_size == 0 { v11.subgroup_size } else { v13.max_subgroup_size },
        max_allocation: v11.max_memory_allocation_size,
        queue_family: family as u32,
        timestamp_bits: families.get(family).map_or(0, |f| f.timestamp_valid_bits),
    }
}

/// All Vulkan devices, the preferred kind first.
pub fn list_devices() -> Result<Vec<DeviceInfo>> {
    let instance = create_instance(Validation::Off)?;
    let infos =
        instance.physical_devices().into_iter().map(|d| probe(&instance.raw, d, Needs::Renderer).info).collect();
    instance.destroy();
    Ok(infos)
}

/// The device that `wanted` names among `devices`; without a name, the first that lacks nothing.
fn choose(devices: &[DeviceInfo], wanted: Option<&str>) -> Result<usize> {
    let list = || {
        let lines: Vec<_> = devices.iter().enumerate().map(|(i, d)| format!("{i}: {} ({})", d.name, d.kind)).collect();
        if lines.is_empty() { "none".to_owned() } else { lines.join("; ") }
    };
    let index = match wanted {
        None if devices.is_empty() => {
            return Err(Error::NoDevice { problem: "no Vulkan device was found".into(), cure: INSTALL_DRIVER.into() });
        }
        None => devices.iter().position(|d| d.missing.is_empty()).unwrap_or(0),
        Some(wanted) => {
            let by_index = wanted.parse::<usize>().ok().filter(|&i| i < devices.len());
            let lower = wanted.to_lowercase();
            let by_name = || devices.iter().position(|d| d.name.to_lowercase().contains(&lower));
            by_index.or_else(by_name).ok_or_else(|| Error::NoDevice {
                problem: format!("--device {wanted}: no such device; there are: {}", list()),
                cure: "give an index or a part of a name from that list (`tyndall devices`)".into(),
            })?
        }
    };
    let chosen = &devices[index];
    if !chosen.missing.is_empty() {
        return Err(Error::MissingFeatures { device: chosen.name.clone(), missing: chosen.missing.clone() });
    }
    Ok(index)
}

/// What a context is made of.
struct Parts<'a> {
    instance: &'a ash::Instance,
    physical: vk::PhysicalDevice,
    device: ash::Device,
    probe: Probe,
    config: ContextConfig,
    debug: Option<ash::ext::debug_utils::Device>,
    executables: Option<ash::khr::pipeline_executable_properties::Device>,
    sink: Arc<Sink>,
    own: Option<Own>,
}

impl Context {
    /// Opens a device.
    ///
    /// Errors: no loader, no device, no validation layer although asked for, or features missing (they are named).
    pub fn new(config: &ContextConfig) -> Result<Self> {
        let instance = create_instance(config.validation)?;
        let physical = instance.physical_devices();
        let mut probes: Vec<_> = physical.iter().map(|&d| probe(&instance.raw, d, Needs::Renderer)).collect();
        let infos: Vec<_> = probes.iter().map(|p| p.info.clone()).collect();
        let index = match choose(&infos, config.device.as_deref()) {
            Ok(index) => index,
            Err(error) => {
                instance.destroy();
                return Err(error);
            }
        };
        let probe = probes.swap_remove(index);
        let tells = config.kernel_statistics && statistics::is_supported(&instance.raw, physical[index]);
        let device = match create_device(&instance, physical[index], &probe, tells) {
            Ok(device) => device,
            Err(error) => {
                instance.destroy();
                return Err(error);
            }
        };
        // SAFETY: the family and index are those the device was made with; the create infos are complete.
        let made = unsafe {
            let queue = device.get_device_queue(probe.queue_family, 0);
            let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
            let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
            let sampler = |filter, mode| {
                let clamp = vk::SamplerAddressMode::CLAMP_TO_EDGE;
                let info = vk::SamplerCreateInfo::default()
                    .mag_filter(filter)
                    .min_filter(filter)
                    .mipmap_mode(mode)
                    .address_mode_u(clamp)
                    .address_mode_v(clamp)
                    .address_mode_w(clamp);
                device.create_sampler(&info, None)
            };
            device.create_semaphore(&info, None).and_then(|timeline| {
                let nearest = sampler(vk::Filter::NEAREST, vk::SamplerMipmapMode::NEAREST)?;
                let linear = sampler(vk::Filter::LINEAR, vk::SamplerMipmapMode::NEAREST)?;
                Ok((queue, timeline, [nearest, linear]))
            })
        };
        let (queue, timeline, samplers) =
            made.map_err(|result| Error::Vulkan { operation: "vkCreateSemaphore", object: "timeline".into(), result })?;
        let parts = Parts {
            instance: &instance.raw.clone(),
            physical: physical[index],
            config: config.clone(),
            debug: instance.messenger.as_ref().map(|_| ash::ext::debug_utils::Device::new(&instance.raw, &device)),
            executables: tells.then(|| ash::khr::pipeline_executable_properties::Device::new(&instance.raw, &device)),
            device,
            probe,
            sink: instance.sink,
            own: Some(Own {
                queue: Mutex::new(queue),
                timeline,
                timeline_value: AtomicU64::new(0),
                samplers,
                messenger: instance.messenger,
                instance: instance.raw,
                entry: instance.entry,
            }),
        };
        Self::assemble(parts)
    }

    /// A context around a device that the caller has made and keeps: for [`crate::primitives`] in command buffers of the
    /// caller's. It has no queue, so [`Recorder::new`] and all that moves data by itself ([`Context::upload`],
    /// [`Context::read_back`], images) is an error.
    ///
    /// The device is of Vulkan 1.3, its instance was made for 1.3 or later, and the features of [`enable_features`] are on.
    ///
    /// Errors: what the physical device or the queue family lacks, by name. Vulkan does not tell which features of a device
    /// are on, so that is for the caller to see to; the validation layer notices.
    ///
    /// # Safety
    /// - The handles are valid and belong together, and the features of [`enable_features`] are on.
    /// - Instance and device live until the context and everything made with it (buffers, pipelines, recorders) is gone.
    pub unsafe fn borrowed(device: &BorrowedDevice<'_>) -> Result<Self> {
        let needs = Needs::Primitives { queue_family: device.queue_family };
        let mut probe = probe(device.instance, device.physical, needs);
        let function = c"vkCmdPipelineBarrier2";
        // SAFETY: the handles are valid, as the caller has promised; the name ends with a zero.
        let found = unsafe { device.instance.get_device_proc_addr(device.device.handle(), function.as_ptr()) };
        if found.is_none() {
            probe.info.missing.push("an instance made for Vulkan 1.3 (vkCmdPipelineBarrier2)".to_owned());
        }
        if !probe.info.missing.is_empty() {
            return Err(Error::MissingFeatures { device: probe.info.name, missing: probe.info.missing });
        }
        Self::assemble(Parts {
            instance: device.instance,
            physical: device.physical,
            device: device.device.clone(),
            probe,
            config: ContextConfig { cache_dir: device.cache_dir.clone(), ..ContextConfig::default() },
            debug: None,
            executables: None,
            sink: Arc::default(),
            own: None,
        })
    }

    fn assemble(parts: Parts<'_>) -> Result<Self> {
        let Parts { instance, physical, device, probe, config, debug, executables, sink, own } = parts;
        // Leaks are reported by `close`, as failures; a log line more would help nobody.
        let mut debug_settings = AllocatorDebugSettings::default();
        debug_settings.log_leaks_on_shutdown = false;
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.clone(),
            device: device.clone(),
            physical_device: physical,
            debug_settings,
            buffer_device_address: false,
            // Beside a program's own memory as little as may be: what is large gets memory of its own anyway.
            allocation_sizes: AllocationSizes::new(if own.is_some() { 16 << 20 } else { 4 << 20 }, 4 << 20),
        })
        .map_err(|e| Error::Device { pass: "memory allocation", problem: format!("no allocator: {e}") })?;
        let (cache_file, cached) = config
            .cache_dir
            .as_deref()
            .map(|folder| CacheFile::open(folder, &probe.properties, &probe.info.driver))
            .unzip();
        // SAFETY: the device is alive; the data are what its driver gave, as the cache file has checked.
        let pipeline_cache = unsafe { create_cache(&device, &cached.unwrap_or_default()) }.map_err(|result| {
            Error::Vulkan { operation: "vkCreatePipelineCache", object: probe.info.name.clone(), result }
        })?;
        let shared = DeviceShared {
            raw: device,
            allocator: Mutex::new(Some(allocator)),
            own,
            queue_family: probe.queue_family,
            pipeline_cache,
            cache_file,
            pipelines: Mutex::default(),
            executables,
            kernels: Mutex::default(),
            limits: probe.properties.limits,
            vendor_id: probe.properties.vendor_id,
            min_subgroup_size: probe.min_subgroup_size,
            max_subgroup_size: probe.max_subgroup_size,
            field_formats: probe.field_formats.clone(),
            has_timestamps: probe.timestamp_bits > 0 && probe.properties.limits.timestamp_period > 0.0,
            debug,
            is_gpu_assisted: config.validation == Validation::GpuAssisted,
            checks_hazards: cfg!(debug_assertions) || config.validation != Validation::Off,
            faults: Faults::new(config.injection),
            sink,
            max_allocation: probe.max_allocation,
            memory: config.memory_limit.unwrap_or_else(|| device_memory(instance, physical)),
            is_memory_limited: config.memory_limit.is_some(),
            bytes_now: AtomicU64::new(0),
            bytes_peak: AtomicU64::new(0),
            ids: AtomicU64::new(1),
        };
        Ok(Self { shared: Arc::new(shared), info: probe.info, config, pipelines: PipelineStore::default() })
    }

    pub(super) fn shared(&self) -> &Arc<DeviceShared> {
        &self.shared
    }

    /// The device in words.
    pub fn device_info(&self) -> &DeviceInfo {
        &self.info
    }

    /// What [`ContextConfig::forward_progress`] said.
    pub fn forward_progress(&self) -> Option<bool> {
        self.config.forward_progress
    }

    /// The checks that run along.
    pub fn validation(&self) -> Validation {
        self.config.validation
    }

    /// Is the device a CPU pretending to be a GPU?
    pub fn is_cpu(&self) -> bool {
        self.info.kind == "CPU"
    }

    /// Can kernels write 3D images of this format, and samplers interpolate them? `Rgba16Float` all devices can that are accepted.
    pub fn stores_fields(&self, format: ImageFormat) -> bool {
        self.shared.field_formats.contains(&format)
    }

    /// Largest number of bytes that one storage binding may cover.
    pub fn max_storage_bytes(&self) -> u64 {
        u64::from(self.shared.limits.max_storage_buffer_range)
    }

    /// Where in a buffer something bound to a shader may start, in bytes.
    pub fn storage_alignment(&self) -> u64 {
        self.shared.limits.min_storage_buffer_offset_alignment.max(4)
    }

    /// PCI vendor of the device, or a Khronos number.
    pub fn vendor_id(&self) -> u32 {
        self.shared.vendor_id
    }

    /// Most invocations of a workgroup along x.
    pub fn max_workgroup(&self) -> u32 {
        let limits = &self.shared.limits;
        limits.max_compute_work_group_invocations.min(limits.max_compute_work_group_size[0])
    }

    /// Shared memory that a workgroup may use, in bytes.
    pub fn max_shared_bytes(&self) -> u32 {
        self.shared.limits.max_compute_shared_memory_size
    }

    /// Fewest invocations that a subgroup of any shader may have.
    pub fn min_subgroup_size(&self) -> u32 {
        self.shared.min_subgroup_size
    }

    /// Most invocations that a subgroup of any shader may have.
    pub fn max_subgroup_size(&self) -> u32 {
        self.shared.max_subgroup_size
    }

    /// Largest number of workgroups along x.
    pub fn max_groups(&self) -> u32 {
        self.shared.limits.max_compute_work_group_count[0]
    }

    /// Largest extent of a 3D image along one axis, in texels.
    pub fn max_image_3d(&self) -> u32 {
        self.shared.limits.max_image_dimension3_d
    }

    /// Messages of the validation layer and of Tyndall's own checks so far.
    pub fn messages(&self) -> Vec<Message> {
        self.shared.sink.messages()
    }

    /// How the pipelines so far came about.
    pub fn pipeline_stats(&self) -> PipelineStats {
        *self.shared.pipelines()
    }

    /// What the driver says about the kernels so far, where [`ContextConfig::kernel_statistics`] asked for it and the
    /// device tells.
    pub fn kernel_statistics(&self) -> Vec<KernelStatistics> {
        self.shared.kernels.lock().unwrap_or_else(|e| e.into_inner()).clone()
    }

    /// Were sound compiled pipelines of earlier contexts found?
    pub fn has_cached_pipelines(&self) -> bool {
        self.shared.cache_file.as_ref().is_some_and(CacheFile::is_found)
    }

    /// Bytes of this device that are made once and then kept in the cache folder, under a name with this prefix. `None` where
    /// there is no such folder or nothing can be kept there; then nothing is made.
    pub fn kept(&self, prefix: &'static str, make: impl FnOnce() -> Result<Vec<u8>>) -> Result<Option<Vec<u8>>> {
        self.shared.cache_file.as_ref().map_or(Ok(None), |file| file.kept(prefix, make))
    }

    pub(super) fn pipeline_store(&self) -> &PipelineStore {
        &self.pipelines
    }

    /// Every kernel that was made so far with the constants that it was given, sorted by name: each form once.
    pub fn kernels(&self) -> Vec<KernelForm> {
        self.pipelines.forms()
    }

    /// Version of the validation layer, where it is on.
    pub fn layer_version(&self) -> Option<String> {
        let own = self.shared.own.as_ref().filter(|_| self.config.validation != Validation::Off)?;
        validation::layer_version(&own.entry)
    }

    /// Bytes of device memory there are.
    pub fn memory(&self) -> u64 {
        self.shared.memory
    }

    /// Bytes of device memory in use.
    pub fn bytes(&self) -> u64 {
        self.shared.bytes_now.load(Ordering::Relaxed)
    }

    /// Largest number of bytes of device memory in use at one time so far.
    pub fn peak_bytes(&self) -> u64 {
        self.shared.bytes_peak.load(Ordering::Relaxed)
    }

    /// A new storage buffer; its contents are undefined.
    pub fn device_buffer<T: Pod>(&self, name: &str, len: usize) -> Result<Buffer<T>> {
        Buffer::new(&self.shared, name, len)
    }

    /// A new storage buffer with these elements.
    pub fn upload<T: Pod>(&self, name: &str, data: &[T]) -> Result<Buffer<T>> {
        let buffer = self.device_buffer(name, data.len())?;
        let bytes: &[u8] = bytemuck::cast_slice(data);
        for (i, chunk) in bytes.chunks(STAGING_BYTES).enumerate() {
            let staging = self.staging(chunk)?;
            let mut recorder = Recorder::new(self)?;
            recorder.copy_raw(&staging, 0, &buffer.raw, (i * STAGING_BYTES) as u64, chunk.len() as u64);
            recorder.submit_and_wait()?;
        }
        Ok(buffer)
    }

    fn staging(&self, bytes: &[u8]) -> Result<Arc<RawBuffer>> {
        let mut staging = RawBuffer::new(&self.shared, "staging.upload", bytes.len() as u64, MemoryLocation::CpuToGpu)?;
        staging.mapped_mut()[..bytes.len()].copy_from_slice(bytes);
        Ok(Arc::new(staging))
    }

    /// The elements of a buffer, once the device has finished everything submitted.
    pub fn read_back<T: Pod>(&self, buffer: &Buffer<T>) -> Result<Vec<T>> {
        self.read_back_range(buffer, 0..buffer.len())
    }

    /// Elements `range` of a buffer, once the device has finished everything submitted.
    pub fn read_back_range<T: Pod>(&self, buffer: &Buffer<T>, range: std::ops::Range<usize>) -> Result<Vec<T>> {
        let mut data = vec![T::zeroed(); range.len()];
        let start = buffer.bytes_of(range).start;
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut data);
        for (i, chunk) in bytes.chunks_mut(STAGING_BYTES).enumerate() {
            let staging = Arc::new(RawBuffer::new(
                &self.shared,
                "staging.read_back",
                chunk.len() as u64,
                MemoryLocation::GpuToCpu,
            )?);
            let mut recorder = Recorder::new(self)?;
            recorder.copy_raw(&buffer.raw, start + (i * STAGING_BYTES) as u64, &staging, 0, chunk.len() as u64);
            recorder.host_read(&staging);
            recorder.submit_and_wait()?;
            chunk.copy_from_slice(&staging.mapped()[..chunk.len()]);
        }
        Ok(data)
    }

    /// A new 3D image, its texels undefined.
    pub fn image_3d(&self, name: &str, extent: [u32; 3], format: ImageFormat) -> Result<Image> {
        self.image(name, extent, true, format)
    }

    /// A new 2D image, its texels undefined.
    pub fn image_2d(&self, name: &str, extent: [u32; 2], format: ImageFormat) -> Result<Image> {
        self.image(name, [extent[0], extent[1], 1], false, format)
    }

    fn image(&self, name: &str, extent: [u32; 3], is_3d: bool, format: ImageFormat) -> Result<Image> {
        let raw = Arc::new(RawImage::new(&self.shared, name, extent, is_3d, format)?);
        let mut recorder = Recorder::new(self)?;
        recorder.init_image(&raw);
        recorder.submit_and_wait()?;
        Ok(Image { raw })
    }

    /// Fills an image layer by layer: `layers(z0..z1)` gives the texels of those layers, x fastest. The texel type
    /// must have the size of the image's format.
    pub fn upload_image<T: Pod>(
        &self,
        image: &Image,
        mut layers: impl FnMut(std::ops::Range<u32>) -> Vec<T>,
    ) -> Result<()> {
        assert_eq!(size_of::<T>() as u64, image.format().bytes(), "texel type of '{}'", image.name());
        for range in layer_chunks(image) {
            let texels = layers(range.clone());
            let expected = u64::from(image.extent()[0]) * u64::from(image.extent()[1]) * range.len() as u64;
            assert_eq!(texels.len() as u64, expected, "texels of '{}'", image.name());
            let staging = self.staging(bytemuck::cast_slice(&texels))?;
            let mut recorder = Recorder::new(self)?;
            recorder.copy_buffer_to_image(&staging, &image.raw, range);
            recorder.submit_and_wait()?;
        }
        Ok(())
    }

    /// The texels of an image, x fastest, once the device has finished everything submitted.
    pub fn read_back_image<T: Pod>(&self, image: &Image) -> Result<Vec<T>> {
        let mut texels = Vec::with_capacity((image.bytes() / image.format().bytes()) as usize);
        for range in layer_chunks(image) {
            texels.extend(self.begin_read_back::<T>(image, range)?.wait()?);
        }
        Ok(texels)
    }

    /// Begins to read back all texels of an image, as everything submitted so far leaves them. What is submitted afterwards
    /// may change the image.
    pub fn begin_read_back_image<T: Pod>(&self, image: &Image) -> Result<ImageReadBack<T>> {
        self.begin_read_back(image, 0..image.extent()[2])
    }

    fn begin_read_back<T: Pod>(&self, image: &Image, layers: std::ops::Range<u32>) -> Result<ImageReadBack<T>> {
        assert_eq!(size_of::<T>() as u64, image.format().bytes(), "texel type of '{}'", image.name());
        let layer = u64::from(image.extent()[0]) * u64::from(image.extent()[1]) * image.format().bytes();
        let bytes = layer * layers.len() as u64;
        let staging = Arc::new(RawBuffer::new(&self.shared, "staging.read_back", bytes, MemoryLocation::GpuToCpu)?);
        let mut recorder = Recorder::new(self)?;
        recorder.copy_image_to_buffer(&image.raw, &staging, layers);
        recorder.host_read(&staging);
        Ok(ImageReadBack { submission: recorder.submit()?, staging, bytes: bytes as usize, texel: PhantomData })
    }

    /// Waits for the device (unless it is borrowed), checks for leaks, tears everything down, and returns every message there
    /// was, the teardown's included.
    pub fn close(self) -> Vec<Message> {
        let Self { shared, pipelines, .. } = self;
        // The owner of a borrowed device has waited: its queues are not ours to touch.
        if shared.own.is_some() {
            // SAFETY: the device is alive; waiting is always allowed from the one thread that owns the context.
            if let Err(result) = unsafe { shared.raw.device_wait_idle() } {
                shared.report(Severity::Error, "TYNDALL-DEVICE", &format!("vkDeviceWaitIdle: {result}"));
            }
        }
        drop(pipelines);
        let report = shared.allocator().as_ref().map(Allocator::generate_report);
        for allocation in report.into_iter().flat_map(|r| r.allocations) {
            shared.report(
                Severity::Error,
                "TYNDALL-LEAK",
                &format!("'{}' still holds {} bytes of device memory", allocation.name, allocation.size),
            );
        }
        let holders = Arc::strong_count(&shared) - 1;
        if holders > 0 {
            shared.report(Severity::Error, "TYNDALL-LEAK", &format!("{holders} Vulkan object(s) outlive the context"));
        }
        let sink = shared.sink.clone();
        drop(shared);
        sink.messages()
    }
}

/// Bytes of the memory that is the device's own.
fn device_memory(instance: &ash::Instance, physical: vk::PhysicalDevice) -> u64 {
    // SAFETY: the physical device is one of the instance's.
    let memory = unsafe { instance.get_physical_device_memory_properties(physical) };
    let own = |heap: &&vk::MemoryHeap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL);
    memory.memory_heaps_as_slice().iter().filter(own).map(|heap| heap.size).sum()
}

/// Layers of an image in pieces of at most `STAGING_BYTES` (one layer at least).
fn layer_chunks(image: &Image) -> Vec<std::ops::Range<u32>> {
    let [width, height, depth] = image.extent();
    let layer = u64::from(width) * u64::from(height) * image.format().bytes();
    let step = (STAGING_BYTES as u64 / layer.max(1)).clamp(1, u64::from(depth.max(1))) as u32;
    (0..depth).step_by(step as usize).map(|z| z..(z + step).min(depth)).collect()
}

/// A cache with these data of an earlier one, or an empty one where the driver refuses them.
///
/// # Safety
/// The device is alive, and `data` are what its driver once gave.
unsafe fn create_cache(device: &ash::Device, data: &[u8]) -> ash::prelude::VkResult<vk::PipelineCache> {
    let info = vk::PipelineCacheCreateInfo::default().initial_data(data);
    // SAFETY: as promised by the caller; `data` outlives the call.
    unsafe { device.create_pipeline_cache(&info, None) }.or_else(|_| {
        // SAFETY: as above.
        unsafe { device.create_pipeline_cache(&vk::PipelineCacheCreateInfo::default(), None) }
    })
}

fn create_device(
    instance: &Instance,
    physical: vk::PhysicalDevice,
    probe: &Probe,
    kernel_statistics: bool,
) -> Result<ash::Device> {
    let priorities = [1.0];
    let queues =
        [vk::DeviceQueueCreateInfo::default().queue_family_index(probe.queue_family).queue_priorities(&priorities)];
    // SAFETY: the instance is alive.
    let has = unsafe { instance.raw.get_physical_device_features(physical) };
    // GPU-assisted validation writes its findings from the shader, and asks for these two where they exist.
    let core = vk::PhysicalDeviceFeatures::default()
        .shader_storage_image_extended_formats(has.shader_storage_image_extended_formats == vk::TRUE)
        .fragment_stores_and_atomics(instance.messenger.is_some() && has.fragment_stores_and_atomics == vk::TRUE)
        .vertex_pipeline_stores_and_atomics(
            instance.messenger.is_some() && has.vertex_pipeline_stores_and_atomics == vk::TRUE,
        );
    // Chained like the others: of `pEnabledFeatures` best practices say in layer 1.4.309 that the device was not asked before
    // (KhronosGroup/Vulkan-ValidationLayers#9900), which it was.
    let mut core = vk::PhysicalDeviceFeatures2::default().features(core);
    let mut f12 = vk::PhysicalDeviceVulkan12Features::default().timeline_semaphore(true);
    let mut f13 = vk::PhysicalDeviceVulkan13Features::default();
    enable_features(&mut f12, &mut f13);
    let mut executables =
        vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default().pipeline_executable_info(true);
    let extensions = [ash::khr::pipeline_executable_properties::NAME.as_ptr()];
    let mut info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .push_next(&mut core)
        .push_next(&mut f12)
        .push_next(&mut f13);
    if kernel_statistics {
        info = info.enabled_extension_names(&extensions).push_next(&mut executables);
    }
    // SAFETY: the chained structs outlive the call; `choose` made sure that the features exist.
    unsafe { instance.raw.create_device(physical, &info, None) }.map_err(|result| Error::Vulkan {
        operation: "vkCreateDevice",
        object: probe.info.name.clone(),
        result,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device(name: &str, missing: &[&str]) -> DeviceInfo {
        DeviceInfo {
            name: name.into(),
            driver: String::new(),
            driver_id: vk::DriverId::default(),
            kind: "CPU",
            api_version: String::new(),
            subgroup_size: 8,
            limits: vec![],
            missing: missing.iter().map(|s| s.to_string()).collect(),
        }
    }

    #[test]
    fn choice_prefers_complete_devices_and_takes_index_or_name() {
        let devices = [device("Old GPU", &["synchronization2"]), device("llvmpipe (LLVM 15)", &[])];
        assert_eq!(choose(&devices, None).unwrap(), 1);
        assert_eq!(choose(&devices, Some("1")).unwrap(), 1);
        assert_eq!(choose(&devices, Some("LLVMpipe")).unwrap(), 1);
    }

    #[test]
    fn a_device_without_a_needed_feature_is_refused_by_the_feature_name() {
        let error = choose(&[device("Old GPU", &["synchronization2", "maintenance4"])], None).unwrap_err();
        assert!(matches!(error, Error::MissingFeatures { .. }));
        let text = error.to_string();
        assert!(text.contains("Old GPU") && text.contains("synchronization2, maintenance4"), "{text}");
    }

    #[test]
    fn unknown_and_absent_devices_say_what_there_is() {
        let text = choose(&[device("llvmpipe", &[])], Some("radeon")).unwrap_err().to_string();
        assert!(text.contains("radeon") && text.contains("0: llvmpipe"), "{text}");
        let text = choose(&[], None).unwrap_err().to_string();
        assert!(text.contains("no Vulkan device") && text.contains("mesa-vulkan-drivers"), "{text}");
    }
}
