//! Compute pipelines made from reflection, specialised by name.

use super::context::{Context, DeviceShared};
use crate::shaders::{BindingKind, LocalSize, ShaderInfo};
use crate::{Error, Result};
use ash::vk;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use std::time::Instant;

pub(super) struct RawPipeline {
    pub(super) handle: vk::Pipeline,
    pub(super) layout: vk::PipelineLayout,
    pub(super) set_layout: vk::DescriptorSetLayout,
    pub(super) shader: &'static ShaderInfo,
    device: Arc<DeviceShared>,
}

impl Drop for RawPipeline {
    fn drop(&mut self) {
        // SAFETY: recorders keep the pipelines they use until the device is done; null handles are ignored.
        unsafe {
            self.device.raw.destroy_pipeline(self.handle, None);
            self.device.raw.destroy_pipeline_layout(self.layout, None);
            self.device.raw.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

/// A compute pipeline. Cloning shares it.
#[derive(Clone)]
pub struct Pipeline {
    pub(super) raw: Arc<RawPipeline>,
    local_size: [u32; 3],
}

/// Pipelines that a context keeps: scenes that follow each other use mostly the same, and a driver may take seconds to compile
/// them. What was not used for long makes room.
#[derive(Default)]
pub(super) struct PipelineStore {
    kept: Mutex<Vec<(Constants, Pipeline)>>,
    made: Mutex<BTreeSet<KernelForm>>,
}

/// Values by name, sorted.
type Constants = Vec<(String, u32)>;

/// A kernel with the values of its specialization constants, by name; those that kept their defaults are not there.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct KernelForm {
    /// Name of the shader.
    pub name: &'static str,
    /// Constants, sorted.
    pub constants: Vec<(String, u32)>,
}

/// A picture takes some thirty.
const MOST_KEPT: usize = 256;

impl PipelineStore {
    fn find(&self, shader: &'static ShaderInfo, constants: &Constants) -> Option<Pipeline> {
        let mut kept = self.kept.lock().unwrap_or_else(|e| e.into_inner());
        let is_it = |(c, p): &(Constants, Pipeline)| std::ptr::eq(p.raw.shader, shader) && c == constants;
        let at = kept.iter().position(is_it)?;
        let found = kept.remove(at);
        kept.push(found);
        kept.last().map(|(_, pipeline)| pipeline.clone())
    }

    fn keep(&self, constants: Constants, pipeline: Pipeline) {
        let mut kept = self.kept.lock().unwrap_or_else(|e| e.into_inner());
        let form = KernelForm { name: pipeline.name(), constants: constants.clone() };
        kept.push((constants, pipeline));
        let too_many = kept.len().saturating_sub(MOST_KEPT);
        kept.drain(..too_many);
        self.made.lock().unwrap_or_else(|e| e.into_inner()).insert(form);
    }

    pub(super) fn forms(&self) -> Vec<KernelForm> {
        self.made.lock().unwrap_or_else(|e| e.into_inner()).iter().cloned().collect()
    }
}

impl Pipeline {
    /// Makes a pipeline, or takes the one that the context keeps. `specialization` sets constants by their GLSL names
    /// (`WORKGROUP` for `local_size_x_id`); the others keep their defaults. A name that the shader does not have is a panic.
    pub fn new(ctx: &Context, shader: &'static ShaderInfo, specialization: &[(&str, u32)]) -> Result<Self> {
        let mut constants: Constants = specialization.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
        constants.sort();
        if let Some(pipeline) = ctx.pipeline_store().find(shader, &constants) {
            return Ok(pipeline);
        }
        let pipeline = Self::make(ctx, shader, specialization)?;
        ctx.pipeline_store().keep(constants, pipeline.clone());
        Ok(pipeline)
    }

    fn make(ctx: &Context, shader: &'static ShaderInfo, specialization: &[(&str, u32)]) -> Result<Self> {
        let device = ctx.shared();
        let error = |operation| move |result| Error::Vulkan { operation, object: shader.name.to_owned(), result };
        let bindings: Vec<_> = shader
            .bindings
            .iter()
            .map(|b| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(b.binding)
                    .descriptor_count(1)
                    .descriptor_type(descriptor_type(b.kind))
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: the device is alive; `bindings` outlives the call.
        let set_layout = unsafe { device.raw.create_descriptor_set_layout(&info, None) }
            .map_err(error("vkCreateDescriptorSetLayout"))?;
        let mut pipeline = RawPipeline {
            handle: vk::Pipeline::null(),
            layout: vk::PipelineLayout::null(),
            set_layout,
            shader,
            device: device.clone(),
        };
        let set_layouts = [set_layout];
        let ranges =
            [vk::PushConstantRange { stage_flags: vk::ShaderStageFlags::COMPUTE, offset: 0, size: shader.push_bytes }];
        let mut info = vk::PipelineLayoutCreateInfo::default().set_layouts(&set_layouts);
        if shader.push_bytes > 0 {
            info = info.push_constant_ranges(&ranges);
        }
        // SAFETY: the arrays outlive the call.
        pipeline.layout =
            unsafe { device.raw.create_pipeline_layout(&info, None) }.map_err(error("vkCreatePipelineLayout"))?;

        let mut entries = Vec::new();
        let mut data: Vec<u32> = Vec::new();
        for (name, value) in specialization {
            let known = shader.specialization.iter().find(|s| s.name == *name);
            let id = known.unwrap_or_else(|| panic!("{} has no specialization constant {name}", shader.name)).id;
            entries.push(vk::SpecializationMapEntry { constant_id: id, offset: data.len() as u32 * 4, size: 4 });
            data.push(*value);
        }
        let local_size = shader.local_size.map(|l| match l {
            LocalSize::Fixed(n) => n,
            LocalSize::Specialized { id, default } => {
                entries.iter().position(|e| e.constant_id == id).map_or(default, |i| data[i])
            }
        });
        let specialization = vk::SpecializationInfo::default().map_entries(&entries).data(bytemuck::cast_slice(&data));
        let words = ash::util::read_spv(&mut std::io::Cursor::new(shader.spirv)).expect("build.rs wrote whole words");
        let info = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: the words are a module that shaderc made for Vulkan 1.3.
        let module = unsafe { device.raw.create_shader_module(&info, None) }.map_err(error("vkCreateShaderModule"))?;
        let mut stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main")
            .specialization_info(&specialization);
        // Subgroup shuffles count on every lane being there. The flag is allowed only where the size divides.
        if local_size[0] % device.max_subgroup_size == 0 {
            stage = stage.flags(vk::PipelineShaderStageCreateFlags::REQUIRE_FULL_SUBGROUPS);
        }
        let mut feedback = vk::PipelineCreationFeedback::default();
        let mut of_stages = [vk::PipelineCreationFeedback::default()];
        let mut feedback_info = vk::PipelineCreationFeedbackCreateInfo::default()
            .pipeline_creation_feedback(&mut feedback)
            .pipeline_stage_creation_feedbacks(&mut of_stages);
        let info =
            vk::ComputePipelineCreateInfo::default().stage(stage).layout(pipeline.layout).push_next(&mut feedback_info);
        let mut info = info;
        if device.executables.is_some() {
            info = info.flags(vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR);
        }
        let start = Instant::now();
        // SAFETY: stage, module, specialization and feedback outlive the call.
        let made = unsafe { device.raw.create_compute_pipelines(device.pipeline_cache, &[info], None) };
        let ms = start.elapsed().as_secs_f64() * 1e3;
        // SAFETY: a module is not needed once the pipeline is made.
        unsafe { device.raw.destroy_shader_module(module, None) };
        let hit = vk::PipelineCreationFeedbackFlags::VALID
            | vk::PipelineCreationFeedbackFlags::APPLICATION_PIPELINE_CACHE_HIT;
        device.count_pipeline(feedback.flags.contains(hit), ms);
        pipeline.handle = made.map_err(|(_, result)| result).map_err(error("vkCreateComputePipelines"))?[0];
        if let Some(functions) = &device.executables {
            // SAFETY: the pipeline was just made by this device, with the flag.
            let statistics = unsafe { super::statistics::of_pipeline(functions, pipeline.handle, shader.name) };
            device.kernels.lock().unwrap_or_else(|e| e.into_inner()).push(statistics);
        }
        device.set_name(pipeline.handle, shader.name);
        device.set_name(pipeline.layout, shader.name);
        device.set_name(pipeline.set_layout, shader.name);
        Ok(Self { raw: Arc::new(pipeline), local_size })
    }

    /// Name of the shader.
    pub fn name(&self) -> &'static str {
        self.raw.shader.name
    }

    /// Workgroup size.
    pub fn local_size(&self) -> [u32; 3] {
        self.local_size
    }
}

pub(super) fn descriptor_type(kind: BindingKind) -> vk::DescriptorType {
    match kind {
        BindingKind::StorageBuffer => vk::DescriptorType::STORAGE_BUFFER,
        BindingKind::StorageImage => vk::DescriptorType::STORAGE_IMAGE,
        BindingKind::SampledImage => vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
    }
}
