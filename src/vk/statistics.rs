//! What the driver says about compiled kernels (`VK_KHR_pipeline_executable_properties`): registers, spills, shared memory.

use ash::vk;
use std::ffi::CStr;

/// Numbers that the driver gives for one kernel.
#[derive(Clone, Debug, serde::Serialize)]
pub struct KernelStatistics {
    /// Name of the shader.
    pub kernel: String,
    /// The driver's names and values.
    pub values: Vec<(String, f64)>,
}

/// Does the device tell?
pub(super) fn is_supported(instance: &ash::Instance, device: vk::PhysicalDevice) -> bool {
    // SAFETY: the instance is alive.
    let extensions = unsafe { instance.enumerate_device_extension_properties(device) }.unwrap_or_default();
    let wanted = ash::khr::pipeline_executable_properties::NAME;
    extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(wanted))
}

/// Of a pipeline that was made with `CAPTURE_STATISTICS`.
///
/// # Safety
/// The pipeline is alive, and of the device of `functions`.
pub(super) unsafe fn of_pipeline(
    functions: &ash::khr::pipeline_executable_properties::Device,
    pipeline: vk::Pipeline,
    kernel: &str,
) -> KernelStatistics {
    let info = vk::PipelineExecutableInfoKHR::default().pipeline(pipeline).executable_index(0);
    // SAFETY: as promised by the caller.
    let statistics = unsafe { functions.get_pipeline_executable_statistics(&info) }.unwrap_or_default();
    let values = statistics.iter().map(|s| {
        // SAFETY: Vulkan's fixed strings are zero-terminated.
        let name = unsafe { CStr::from_ptr(s.name.as_ptr()) }.to_string_lossy().into_owned();
        // SAFETY: `format` says which member of the union is set.
        let value = unsafe {
            match s.format {
                vk::PipelineExecutableStatisticFormatKHR::BOOL32 => f64::from(s.value.b32),
                vk::PipelineExecutableStatisticFormatKHR::INT64 => s.value.i64 as f64,
                vk::PipelineExecutableStatisticFormatKHR::UINT64 => s.value.u64 as f64,
                _ => s.value.f64,
            }
        };
        (name, value)
    });
    KernelStatistics { kernel: kernel.to_owned(), values: values.collect() }
}
