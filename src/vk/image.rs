//! Images: voxel fields (3D) and pictures (2D). They stay in the GENERAL layout for their whole life.

use super::access::ALL_STAGES;
use super::buffer::{Bind, Filter};
use super::context::DeviceShared;
use crate::{Error, Result};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use std::sync::Arc;

/// Texel formats in use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the variants are Vulkan's formats")]
pub enum ImageFormat {
    R32Uint,
    R32Float,
    Rgba16Float,
    Rgba32Float,
    /// One channel; samplers read (0, 0, 0, r).
    Alpha32Float,
    /// Two channels; samplers read (r, r, r, g).
    GreyAlpha16Float,
    /// The same with 32 bits each.
    GreyAlpha32Float,
}

impl ImageFormat {
    /// Bytes of a texel.
    pub fn bytes(self) -> u64 {
        match self {
            ImageFormat::R32Uint
            | ImageFormat::R32Float
            | ImageFormat::Alpha32Float
            | ImageFormat::GreyAlpha16Float => 4,
            ImageFormat::Rgba16Float | ImageFormat::GreyAlpha32Float => 8,
            ImageFormat::Rgba32Float => 16,
        }
    }

    pub(super) fn to_vk(self) -> vk::Format {
        match self {
            ImageFormat::R32Uint => vk::Format::R32_UINT,
            ImageFormat::R32Float | ImageFormat::Alpha32Float => vk::Format::R32_SFLOAT,
            ImageFormat::Rgba16Float => vk::Format::R16G16B16A16_SFLOAT,
            ImageFormat::Rgba32Float => vk::Format::R32G32B32A32_SFLOAT,
            ImageFormat::GreyAlpha16Float => vk::Format::R16G16_SFLOAT,
            ImageFormat::GreyAlpha32Float => vk::Format::R32G32_SFLOAT,
        }
    }

    /// What samplers read as r, g, b, a; `None`: the channels as they are. Storage images cannot be read in another order.
    fn sampled_as(self) -> Option<vk::ComponentMapping> {
        use vk::ComponentSwizzle as C;
        match self {
            ImageFormat::R32Float => Some(vk::ComponentMapping { r: C::R, g: C::R, b: C::R, a: C::ONE }),
            ImageFormat::Alpha32Float => Some(vk::ComponentMapping { r: C::ZERO, g: C::ZERO, b: C::ZERO, a: C::R }),
            ImageFormat::GreyAlpha16Float | ImageFormat::GreyAlpha32Float => {
                Some(vk::ComponentMapping { r: C::R, g: C::R, b: C::R, a: C::G })
            }
            ImageFormat::R32Uint | ImageFormat::Rgba16Float | ImageFormat::Rgba32Float => None,
        }
    }
}

/// A Vulkan image with view and memory.
pub(super) struct RawImage {
    pub(super) handle: vk::Image,
    pub(super) view: vk::ImageView,
    /// For samplers, where they read the channels in another order.
    reordered: Option<vk::ImageView>,
    allocation: Option<Allocation>,
    pub(super) extent: [u32; 3],
    pub(super) format: ImageFormat,
    pub(super) name: String,
    pub(super) id: u64,
    device: Arc<DeviceShared>,
}

impl RawImage {
    pub(super) fn new(
        device: &Arc<DeviceShared>,
        name: &str,
        extent: [u32; 3],
        is_3d: bool,
        format: ImageFormat,
    ) -> Result<Self> {
        let limit = if is_3d { device.limits.max_image_dimension3_d } else { device.limits.max_image_dimension2_d };
        let longest = extent.into_iter().max().unwrap_or(0);
        if longest > limit {
            return Err(Error::DeviceMemory {
                object: name.to_owned(),
                needed: u64::from(longest),
                limit: u64::from(limit),
                limit_name: if is_3d { "maxImageDimension3D (voxels)" } else { "maxImageDimension2D (pixels)" },
                cure: "resample the volume or make the picture smaller".into(),
            });
        }
        let info = vk::ImageCreateInfo::default()
            .image_type(if is_3d { vk::ImageType::TYPE_3D } else { vk::ImageType::TYPE_2D })
            .format(format.to_vk())
            .extent(vk::Extent3D { width: extent[0], height: extent[1], depth: extent[2] })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(
                vk::ImageUsageFlags::SAMPLED
                    | vk::ImageUsageFlags::STORAGE
                    | vk::ImageUsageFlags::TRANSFER_SRC
                    | vk::ImageUsageFlags::TRANSFER_DST,
            )
            .initial_layout(vk::ImageLayout::UNDEFINED);
        let error = |operation| move |result| Error::Vulkan { operation, object: name.to_owned(), result };
        // SAFETY: the device is alive; the create info is complete and within the limits checked above.
        let handle = unsafe { device.raw.create_image(&info, None) }.map_err(error("vkCreateImage"))?;
        let mut image = Self {
            handle,
            view: vk::ImageView::null(),
            reordered: None,
            allocation: None,
            extent,
            format,
            name: name.to_owned(),
            id: device.next_id(),
            device: device.clone(),
        };
        // SAFETY: `handle` was just made by this device.
        let requirements = unsafe { device.raw.get_image_memory_requirements(handle) };
        // Large images get memory of their own, so that it goes back as soon as the image does.
        let allocation_scheme = if requirements.size > 16 << 20 {
            AllocationScheme::DedicatedImage(handle)
        } else {
            AllocationScheme::GpuAllocatorManaged
        };
        let allocation = device.allocate(&AllocationCreateDesc {
            name,
            requirements,
            location: MemoryLocation::GpuOnly,
            linear: false,
            allocation_scheme,
        })?;
        let (memory, offset) = {
            // SAFETY: the memory handle is used only to bind the image, and lives as long as `allocation`.
            let memory = unsafe { allocation.memory() };
            (memory, allocation.offset())
        };
        image.allocation = Some(allocation);
        // SAFETY: the memory is unbound and fits the image's requirements.
        unsafe { device.raw.bind_image_memory(handle, memory, offset) }.map_err(error("vkBindImageMemory"))?;
        let info = vk::ImageViewCreateInfo::default()
            .image(handle)
            .view_type(if is_3d { vk::ImageViewType::TYPE_3D } else { vk::ImageViewType::TYPE_2D })
            .format(format.to_vk())
            .subresource_range(WHOLE);
        // SAFETY: the image is bound and its usage allows views.
        image.view = unsafe { device.raw.create_image_view(&info, None) }.map_err(error("vkCreateImageView"))?;
        device.set_name(handle, name);
        device.set_name(image.view, name);
        if let Some(components) = format.sampled_as() {
            let info = info.components(components);
            // SAFETY: as above.
            let view = unsafe { device.raw.create_image_view(&info, None) }.map_err(error("vkCreateImageView"))?;
            image.reordered = Some(view);
            device.set_name(view, name);
        }
        Ok(image)
    }

    /// The view that samplers read.
    pub(super) fn sampled_view(&self) -> vk::ImageView {
        self.reordered.unwrap_or(self.view)
    }
}

/// The one subresource that our images have.
pub(super) const WHOLE: vk::ImageSubresourceRange = vk::ImageSubresourceRange {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    base_mip_level: 0,
    level_count: 1,
    base_array_layer: 0,
    layer_count: 1,
};

/// UNDEFINED to GENERAL: the only layout change there is.
pub(super) fn init_barrier(image: vk::Image) -> vk::ImageMemoryBarrier2<'static> {
    vk::ImageMemoryBarrier2::default()
        .dst_stage_mask(ALL_STAGES)
        .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)
        .old_layout(vk::ImageLayout::UNDEFINED)
        .new_layout(vk::ImageLayout::GENERAL)
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .image(image)
        .subresource_range(WHOLE)
}

impl Drop for RawImage {
    fn drop(&mut self) {
        // SAFETY: whoever used the image kept it alive until the device was done with it; null views are ignored.
        unsafe {
            self.device.raw.destroy_image_view(self.view, None);
            self.device.raw.destroy_image_view(self.reordered.unwrap_or_default(), None);
            self.device.raw.destroy_image(self.handle, None);
        }
        if let Some(allocation) = self.allocation.take() {
            self.device.free(allocation);
        }
    }
}

/// An image in device memory. Cloning shares it.
#[derive(Clone)]
pub struct Image {
    pub(super) raw: Arc<RawImage>,
}

impl Image {
    /// Width, height, depth in texels.
    pub fn extent(&self) -> [u32; 3] {
        self.raw.extent
    }

    /// Texel format.
    pub fn format(&self) -> ImageFormat {
        self.raw.format
    }

    /// Bytes of all texels.
    pub fn bytes(&self) -> u64 {
        self.raw.extent.iter().map(|&e| u64::from(e)).product::<u64>() * self.raw.format.bytes()
    }

    /// Debug name.
    pub fn name(&self) -> &str {
        &self.raw.name
    }

    /// To be bound as a combined image sampler (`sampler3D`, `usampler3D`, `sampler2D`).
    pub fn sampled(&self, filter: Filter) -> Bind<'_> {
        Bind::Sampled(&self.raw, filter)
    }

    /// To be bound as a storage image (`image3D`, `uimage3D`, `image2D`).
    pub fn storage(&self) -> Bind<'_> {
        Bind::Storage(&self.raw)
    }
}
