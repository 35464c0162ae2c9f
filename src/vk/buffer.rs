//! Typed storage buffers in device memory.

use super::context::{Context, DeviceShared};
use super::image::RawImage;
use crate::{Error, Result};
use ash::vk::{self, Handle};
use bytemuck::Pod;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use std::marker::PhantomData;
use std::ops::Range;
use std::sync::Arc;

/// A Vulkan buffer with its memory. Dropped when nothing refers to it any more, recorders in flight included.
pub(super) struct RawBuffer {
    pub(super) handle: vk::Buffer,
    pub(super) allocation: Option<Allocation>,
    pub(super) bytes: u64,
    pub(super) name: String,
    pub(super) id: u64,
    /// Somebody else's: not to be destroyed.
    is_borrowed: bool,
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
            is_borrowed: false,
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
        if self.is_borrowed {
            return;
        }
        // SAFETY: whoever used the buffer kept it alive until the device was done with it.
        unsafe { self.device.raw.destroy_buffer(self.handle, None) };
        if let Some(allocation) = self.allocation.take() {
            self.device.free(allocation);
        }
    }
}

/// An array of `T` in device memory: a buffer or a part of one. Cloning shares it.
pub struct Buffer<T> {
    pub(super) raw: Arc<RawBuffer>,
    /// Bytes of `raw` that this is.
    pub(super) range: Range<u64>,
    len: usize,
    element: PhantomData<T>,
}

impl<T> Clone for Buffer<T> {
    fn clone(&self) -> Self {
        Self { raw: self.raw.clone(), range: self.range.clone(), len: self.len, element: PhantomData }
    }
}

impl<T: Pod> Buffer<T> {
    pub(super) fn new(device: &Arc<DeviceShared>, name: &str, len: usize) -> Result<Self> {
        let bytes = (len as u64).saturating_mul(size_of::<T>() as u64);
        let raw = RawBuffer::new(device, name, bytes, MemoryLocation::GpuOnly)?;
        Ok(Self { range: 0..raw.bytes, raw: Arc::new(raw), len, element: PhantomData })
    }

    /// `bytes` bytes from byte `offset` on of a buffer that the caller has made and keeps. `name` is for messages.
    ///
    /// Errors: `offset` is not a multiple of [`Context::storage_alignment`], or `bytes` is 0 or no multiple of an element's size.
    ///
    /// # Safety
    /// - `handle` is a buffer of the context's device, bound to memory, with `VK_BUFFER_USAGE_STORAGE_BUFFER_BIT` (as
    ///   scratch memory with `TRANSFER_DST` and `INDIRECT_BUFFER` too), and holds `offset + bytes` bytes.
    /// - It lives until the device is done with all commands that were recorded with this or a clone of it.
    /// - It is exclusive to the queue family that the commands are submitted to, or shared with it.
    pub unsafe fn borrowed(ctx: &Context, name: &str, handle: vk::Buffer, offset: u64, bytes: u64) -> Result<Self> {
        let (alignment, size) = (ctx.storage_alignment(), size_of::<T>() as u64);
        if bytes == 0 || !offset.is_multiple_of(alignment) || !bytes.is_multiple_of(size) {
            return Err(Error::input(
                format!("buffer '{name}'"),
                format!("{bytes} bytes from byte {offset} on"),
                format!(
                    "offsets must be multiples of {alignment} (minStorageBufferOffsetAlignment), sizes multiples of {size} and not 0"
                ),
            ));
        }
        let device = ctx.shared();
        let raw = RawBuffer {
            handle,
            allocation: None,
            bytes: offset + bytes,
            name: name.to_owned(),
            // Two borrowed parts of one buffer are one resource to the hazard check. Numbers of our own are small.
            id: handle.as_raw() | 1 << 63,
            is_borrowed: true,
            device: device.clone(),
        };
        Ok(Self {
            raw: Arc::new(raw),
            range: offset..offset + bytes,
            len: (bytes / size) as usize,
            element: PhantomData,
        })
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
        self.range.end - self.range.start
    }

    /// Debug name.
    pub fn name(&self) -> &str {
        &self.raw.name
    }

    /// Elements `range` as an array of their own. To be bound to a shader, it must start at a multiple of
    /// [`Context::storage_alignment`].
    pub fn slice(&self, range: Range<usize>) -> Self {
        assert!(range.start <= range.end && range.end <= self.len, "elements {range:?} of '{}'", self.name());
        let len = range.len();
        Self { raw: self.raw.clone(), range: self.bytes_of(range), len, element: PhantomData }
    }

    /// The same memory as words of 4 bytes.
    pub fn words(&self) -> Buffer<u32> {
        let len = self.len * size_of::<T>() / 4;
        Buffer { raw: self.raw.clone(), range: self.range.clone(), len, element: PhantomData }
    }

    /// Are the two the same memory?
    pub fn is_same(&self, other: &Self) -> bool {
        self.raw.handle == other.raw.handle && self.range == other.range
    }

    /// Do the two share memory?
    pub fn overlaps<U>(&self, other: &Buffer<U>) -> bool {
        self.raw.handle == other.raw.handle && self.range.start < other.range.end && other.range.start < self.range.end
    }

    /// The whole array, to be bound to a shader.
    pub fn bind(&self) -> Bind<'_> {
        Bind::Buffer(&self.raw, self.range.clone())
    }

    /// Elements `range`, to be bound to a shader. The start must be a multiple of [`Context::storage_alignment`] bytes.
    pub fn bind_range(&self, range: Range<usize>) -> Bind<'_> {
        Bind::Buffer(&self.raw, self.bytes_of(range))
    }

    /// Bytes of the raw buffer that elements `range` are.
    pub(super) fn bytes_of(&self, range: Range<usize>) -> Range<u64> {
        let size = size_of::<T>() as u64;
        self.range.start + range.start as u64 * size..self.range.start + range.end as u64 * size
    }
}

/// Words in memory of the host, which the device writes by [`Recorder::copy_to_host`](super::Recorder::copy_to_host).
pub struct HostWords {
    pub(super) raw: Arc<RawBuffer>,
    len: usize,
}

impl HostWords {
    /// New words that hold `initial` until the device has written them.
    pub fn new(ctx: &Context, name: &str, initial: &[u32]) -> Result<Self> {
        let mut raw = RawBuffer::new(ctx.shared(), name, size_of_val(initial) as u64, MemoryLocation::GpuToCpu)?;
        raw.mapped_mut()[..size_of_val(initial)].copy_from_slice(bytemuck::cast_slice(initial));
        Ok(Self { raw: Arc::new(raw), len: initial.len() })
    }

    /// The words: what the device wrote, once the submission is known to be done.
    pub fn read(&self) -> Vec<u32> {
        let words = self.raw.mapped().as_ptr().cast::<u32>();
        // SAFETY: the mapping holds `len` words, is aligned for them and lives as long as `raw`. The device may be
        // writing them, hence volatile.
        (0..self.len).map(|i| unsafe { words.add(i).read_volatile() }).collect()
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
    Buffer(&'a Arc<RawBuffer>, Range<u64>),
    /// A combined image sampler.
    Sampled(&'a Arc<RawImage>, Filter),
    /// A storage image.
    Storage(&'a Arc<RawImage>),
}
