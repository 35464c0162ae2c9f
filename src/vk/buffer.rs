//! Typed storage buffers in device memory.

use super::context::DeviceShared;
use super::image::RawImage;
use crate::{Error, Result};
use ash::vk;
use bytemuck::Pod;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use std::marker::PhantomData;
use std::sync::Arc;

/// A Vulkan buffer with its memory. Dropped when nothing refers to it any more, recorders in flight included.
pub(super) struct RawBuffer {
    pub(super) handle: vk::Buffer,
    pub(super) allocation: Option<Allocation>,
    pub(super) bytes: u64,
    pub(super) name: String,
    pub(super) id: u64,
    device: Arc<DeviceShared>,
}

impl RawBuffer {
    pub(super) fn new(device: &Arc<DeviceShared>, name: &str, bytes: u64, location: MemoryLocation) -> Result<Self> {
        // Vulkan forbids empty buffers, and an empty list is a list. Whole vectors of four words, so that kernels may
        // read the last words as one.
        let bytes = bytes.max(1).next_multiple_of(16);
        let limit = u64::from(device.limits.max_storage_buffer_range);
        if location == MemoryLocation::GpuOnly && bytes > limit {
            return Err(Error::DeviceMemory {
                object: name.to_owned(),
                needed: bytes,
                limit,
                limit_name: "maxStorageBufferRange",
                cure: "use a smaller volume, fewer candidates or a coarser mask".into(),
            });
        }
        let mut usage = vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
        if location == MemoryLocation::GpuOnly {
            usage |= vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::INDIRECT_BUFFER;
        }
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage);
        // SAFETY: the device is alive; the create info is complete.
        let handle = unsafe { device.raw.create_buffer(&info, None) }.map_err(|result| Error::Vulkan {
            operation: "vkCreateBuffer",
            object: name.to_owned(),
            result,
        })?;
        // SAFETY: `handle` was just made by this device.
        let requirements = unsafe { device.raw.get_buffer_memory_requirements(handle) };
        let allocation = device.allocate(&AllocationCreateDesc {
            name,
            requirements,
            location,
            linear: true,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        });
        let allocation = match allocation {
            Ok(allocation) => allocation,
            Err(error) => {
                // SAFETY: nothing uses the buffer yet.
                unsafe { device.raw.destroy_buffer(handle, None) };
                return Err(error);
            }
        };
        let buffer = Self {
            handle,
            allocation: Some(allocation),
            bytes,
            name: name.to_owned(),
            id: device.next_id(),
            device: device.clone(),
        };
        let allocation = buffer.allocation.as_ref().expect("just set");
        // SAFETY: the memory belongs to this allocation, is unbound, and fits the buffer's requirements.
        unsafe { device.raw.bind_buffer_memory(handle, allocation.memory(), allocation.offset()) }
            .map_err(|result| Error::Vulkan { operation: "vkBindBufferMemory", object: name.to_owned(), result })?;
        device.set_name(handle, name);
        Ok(buffer)
    }

    /// The bytes of a host-visible buffer.
    pub(super) fn mapped(&self) -> &[u8] {
        let slice = self.allocation.as_ref().and_then(Allocation::mapped_slice);
        &slice.expect("upload and read-back buffers are host visible")[..self.bytes as usize]
    }

    /// The bytes of a host-visible buffer, to be written.
    pub(super) fn mapped_mut(&mut self) -> &mut [u8] {
        let bytes = self.bytes as usize;
        let slice = self.allocation.as_mut().and_then(Allocation::mapped_slice_mut);
        &mut slice.expect("upload and read-back buffers are host visible")[..bytes]
    }
}

impl Drop for RawBuffer {
    fn drop(&mut self) {
        // SAFETY: whoever used the buffer kept it alive until the device was done with it.
        unsafe { self.device.raw.destroy_buffer(self.handle, None) };
        if let Some(allocation) = self.allocation.take() {
            self.device.free(allocation);
        }
    }
}

/// An array of `T` in device memory. Cloning shares it.
pub struct Buffer<T> {
    pub(super) raw: Arc<RawBuffer>,
    len: usize,
    element: PhantomData<T>,
}

impl<T> Clone for Buffer<T> {
    fn clone(&self) -> Self {
        Self { raw: self.raw.clone(), len: self.len, element: PhantomData }
    }
}

impl<T: Pod> Buffer<T> {
    pub(super) fn new(device: &Arc<DeviceShared>, name: &str, len: usize) -> Result<Self> {
        let bytes = (len as u64).saturating_mul(size_of::<T>() as u64);
        let raw = RawBuffer::new(device, name, bytes, MemoryLocation::GpuOnly)?;
        Ok(Self { raw: Arc::new(raw), len, element: PhantomData })
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True if there are no elements.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Bytes in device memory.
    pub fn bytes(&self) -> u64 {
        self.raw.bytes
    }

    /// Debug name.
    pub fn name(&self) -> &str {
        &self.raw.name
    }

    /// The whole buffer, to be bound to a shader.
    pub fn bind(&self) -> Bind<'_> {
        Bind::Buffer(&self.raw, 0..self.raw.bytes)
    }

    /// Elements `range`, to be bound to a shader. The start must be a multiple of the device's
    /// `minStorageBufferOffsetAlignment` bytes.
    pub fn bind_range(&self, range: std::ops::Range<usize>) -> Bind<'_> {
        let size = size_of::<T>() as u64;
        Bind::Buffer(&self.raw, range.start as u64 * size..range.end as u64 * size)
    }
}

/// Filter of a sampled image; addresses are clamped to the edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "the variants say it")]
pub enum Filter {
    Nearest,
    Linear,
}

/// Something bound to a shader's resource.
#[derive(Clone)]
#[allow(private_interfaces, reason = "made by Buffer::bind, Image::sampled and Image::storage only")]
pub enum Bind<'a> {
    /// Bytes of a storage buffer.
    Buffer(&'a Arc<RawBuffer>, std::ops::Range<u64>),
    /// A combined image sampler.
    Sampled(&'a Arc<RawImage>, Filter),
    /// A storage image.
    Storage(&'a Arc<RawImage>),
}
