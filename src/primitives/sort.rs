//! The radix sort.

use super::{Buffer, Carry, Context, Count, Recording, bound, carry_on, check_apart, most_items};
use crate::passes::radix_sort::{KeyKind, RadixSort, RadixSortConfig, SortMemory};
use crate::passes::tuning::Tuning;
use crate::{Error, Result};
use bytemuck::Pod;
use std::marker::PhantomData;
use std::ops::Range;

mod sealed {
    pub trait Sealed {}
    impl Sealed for u32 {}
    impl Sealed for i32 {}
    impl Sealed for f32 {}
}

/// What can be sorted by.
pub trait Key: Pod + sealed::Sealed {
    /// What the shaders take it for.
    const KIND: KeyKind;
}

impl Key for u32 {
    const KIND: KeyKind = KeyKind::U32;
}

impl Key for i32 {
    const KIND: KeyKind = KeyKind::I32;
}

/// In the order of [`f32::total_cmp`]: −NaN, −∞, …, −0.0, +0.0, …, +∞, +NaN. All bits count and are kept, those of NaNs too.
impl Key for f32 {
    const KIND: KeyKind = KeyKind::F32;
}

/// Which key comes first. Equal keys keep their order either way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// The smallest.
    Ascending,
    /// The largest.
    Descending,
}

/// What goes along with every key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Payloads {
    /// Nothing.
    None,
    /// A word.
    U32,
}

/// Where items come from and where they go. `(&from, &to)` makes one, and so does `&buffer`: there and back.
#[derive(Clone, Copy)]
pub struct FromTo<'a, T> {
    /// Is read.
    pub from: &'a Buffer<T>,
    /// Is written: the same memory, or such as does not overlap.
    pub to: &'a Buffer<T>,
}

impl<'a, T> From<&'a Buffer<T>> for FromTo<'a, T> {
    fn from(buffer: &'a Buffer<T>) -> Self {
        Self { from: buffer, to: buffer }
    }
}

impl<'a, T> From<(&'a Buffer<T>, &'a Buffer<T>)> for FromTo<'a, T> {
    fn from((from, to): (&'a Buffer<T>, &'a Buffer<T>)) -> Self {
        Self { from, to }
    }
}

impl<T: Pod> FromTo<'_, T> {
    fn words(&self) -> [Buffer<u32>; 2] {
        [self.from.words(), self.to.words()]
    }
}

/// A stable radix sort (OneSweep) of keys, with a payload each or without: its pipelines.
pub struct Sort<K> {
    pass: RadixSort,
    payloads: Payloads,
    key: PhantomData<K>,
}

/// Memory of sorts of up to so many items.
pub struct SortScratch {
    memory: SortMemory,
    capacity: u32,
    /// The caller's memory that it is in.
    within: Option<Buffer<u32>>,
}

const WHAT: &str = "sort";

impl<K: Key> Sort<K> {
    /// Makes the pipelines, in the shape that suits the device.
    ///
    /// Errors: the device shares too little memory in a workgroup, or a Vulkan call fails.
    pub fn new(ctx: &Context, order: Order, payloads: Payloads) -> Result<Self> {
        Self::with_carry(ctx, order, payloads, carry_on(ctx))
    }

    /// The same, with counts carried in this way instead of the one for the driver.
    pub fn with_carry(ctx: &Context, order: Order, payloads: Payloads, carry: Carry) -> Result<Self> {
        let config = RadixSortConfig {
            payloads: payloads == Payloads::U32,
            kind: K::KIND,
            descending: order == Order::Descending,
            ends_amid: true,
            carry,
            ..Tuning::of(ctx).sort
        };
        Ok(Self { pass: RadixSort::new(ctx, config)?, payloads, key: PhantomData })
    }

    /// Items of a tile: what a workgroup sorts.
    pub fn tile(&self) -> u32 {
        self.pass.tile()
    }

    /// Bytes that [`Sort::scratch_in`] takes for sorts of up to `capacity` items: 4 per item (8 with payloads), and 4 KiB
    /// for every tile. Nothing is allocated.
    pub fn scratch_bytes(&self, ctx: &Context, capacity: u32) -> u64 {
        4 * self.pass.memory_words(ctx, capacity)
    }

    /// Scratch memory of ours for sorts of up to `capacity` items.
    ///
    /// Errors: `capacity` is above [`MAX_ITEMS`](super::MAX_ITEMS) or what the device binds, or memory runs out.
    pub fn scratch(&self, ctx: &Context, capacity: u32) -> Result<SortScratch> {
        Ok(SortScratch { memory: self.pass.memory(ctx, None, capacity)?, capacity, within: None })
    }

    /// Scratch memory of the caller's for sorts of up to `capacity` items: the first [`Sort::scratch_bytes`] of `memory`,
    /// whose buffer has the usages `STORAGE_BUFFER`, `TRANSFER_DST` and `INDIRECT_BUFFER`.
    ///
    /// Errors: as [`Sort::scratch`], and `memory` is too small.
    pub fn scratch_in(&self, ctx: &Context, memory: &Buffer<u32>, capacity: u32) -> Result<SortScratch> {
        let within = Some(memory.clone());
        Ok(SortScratch { memory: self.pass.memory(ctx, Some(memory), capacity)?, capacity, within })
    }

    /// Sorts the first `count` keys by bits `bits`, of a sort without payloads.
    ///
    /// `keys` is a buffer, which is sorted in place, or `(&from, &to)`; then `from` stays as it is.
    ///
    /// `bits` counts from the lowest bit, and `0..32` sorts by the whole key; keys that agree in those bits keep their order.
    /// Of an i32 or f32 the bits are those of the word that, as a u32, is in the keys' order: `key ^ 0x8000_0000` for i32 and
    /// for an f32 whose sign is clear, `!key` for one whose sign is set. It takes one pass over memory per 8 bits; in
    /// place, an odd number is rounded up.
    ///
    /// | buffer | first access | last access |
    /// |---|---|---|
    /// | `from` | `COMPUTE_SHADER`, `SHADER_STORAGE_READ` | the same |
    /// | `to` | `COMPUTE_SHADER`, `SHADER_STORAGE_WRITE` | `COMPUTE_SHADER`, `SHADER_STORAGE_WRITE` |
    /// | in place | `COMPUTE_SHADER`, `SHADER_STORAGE_READ` | `COMPUTE_SHADER`, `SHADER_STORAGE_WRITE` |
    /// | count on the GPU | `COMPUTE_SHADER`, `SHADER_STORAGE_READ` | the same |
    /// | scratch | `ALL_TRANSFER`, `TRANSFER_WRITE`, and `COMPUTE_SHADER`, `SHADER_STORAGE_WRITE` | `COMPUTE_SHADER`, `SHADER_STORAGE_READ` and `SHADER_STORAGE_WRITE`, and `DRAW_INDIRECT`, `INDIRECT_COMMAND_READ` |
    ///
    /// Recorded inside: see the [module](super). Scratch memory may be used again by the next `record…` without a barrier.
    ///
    /// Errors: the sort has payloads; a count beyond buffers or scratch memory (on the GPU:
    /// [`Recorded::check`](super::Recorded::check)); bits beyond 32; memory that overlaps and must not.
    pub fn record_keys<'a>(
        &self,
        recording: &mut Recording,
        keys: impl Into<FromTo<'a, K>>,
        count: Count<'_>,
        bits: Range<u32>,
        scratch: &SortScratch,
    ) -> Result<()> {
        self.record(recording, keys.into().words(), None, count, bits, scratch)
    }

    /// The same for a sort with payloads: the payload of each key goes where the key goes. Both are sorted in place, or
    /// both are not. Accesses to payloads are as those to keys.
    pub fn record_pairs<'a>(
        &self,
        recording: &mut Recording,
        keys: impl Into<FromTo<'a, K>>,
        payloads: impl Into<FromTo<'a, u32>>,
        count: Count<'_>,
        bits: Range<u32>,
        scratch: &SortScratch,
    ) -> Result<()> {
        self.record(recording, keys.into().words(), Some(payloads.into().words()), count, bits, scratch)
    }

    fn record(
        &self,
        recording: &mut Recording,
        keys: [Buffer<u32>; 2],
        payloads: Option<[Buffer<u32>; 2]>,
        count: Count<'_>,
        bits: Range<u32>,
        scratch: &SortScratch,
    ) -> Result<()> {
        if payloads.is_some() != (self.payloads == Payloads::U32) {
            let problem = format!("it was made for Payloads::{:?}", self.payloads);
            return Err(Error::input(
                WHAT,
                problem,
                "record_keys goes with Payloads::None, record_pairs with Payloads::U32",
            ));
        }
        if bits.start > bits.end || bits.end > 32 {
            return Err(Error::input(WHAT, format!("bits {bits:?} of a 32-bit key"), "give bits within 0..32"));
        }
        let mut arrays = Vec::new();
        let mut in_place = Vec::new();
        for (names, [from, to]) in
            [(["keys", "sorted keys"], Some(&keys)), (["payloads", "sorted payloads"], payloads.as_ref())]
                .into_iter()
                .filter_map(|(names, arrays)| Some((names, arrays?)))
        {
            in_place.push(from.is_same(to));
            arrays.push((names[0], from));
            if !from.is_same(to) {
                arrays.push((names[1], to));
            }
        }
        if in_place.first() != in_place.last() {
            let problem = "keys or payloads are sorted in place, but not both";
            return Err(Error::input(WHAT, problem, "sort both in place, or neither"));
        }
        arrays.extend(scratch.within.iter().map(|within| ("scratch memory", within)));
        check_apart(WHAT, &arrays)?;
        let lengths = keys.iter().chain(payloads.iter().flatten()).map(Buffer::len);
        let items = most_items(WHAT, count, lengths.fold(scratch.capacity as usize, usize::min))?;
        let [keys_from, keys_to] = keys.map(|array| bound(&array, items));
        let [payloads_from, payloads_to] = match payloads {
            Some(payloads) => payloads.map(|array| Some(bound(&array, items))),
            None => [None, None],
        };
        self.pass.record_into(
            &mut recording.recorder,
            (&keys_from, payloads_from.as_ref()),
            (&keys_to, payloads_to.as_ref()),
            count,
            bits,
            (&scratch.memory, &recording.diagnostics),
        );
        Ok(())
    }
}
