//! The file of corners: three vertices for each triangle that is kept, in slots.
//!
//! A slot has a fixed capacity for consecutive triangles of the inputs; those that are kept are at its beginning. Slots can
//! be written in any order, so that each is written as soon as its corners are known. If triangles are dropped, gaps remain,
//! which most file systems do not store if nothing was written there; they count as bytes of the scratch folder. Every slot
//! has a checksum, which is compared when the slot is read.

use super::words::{Layout, read_words_with_sum, write_words};
use crate::scratch::{Scratch, ScratchError, ScratchFile};
use serde::{Deserialize, Serialize};

/// Name of the file.
pub(super) const CORNERS: &str = "corners";

/// What is in the slots.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Slots {
    /// Maximum number of triangles in a slot.
    capacity: u32,
    /// Number of triangles in each slot, and the CRC-32 of their bytes.
    filled: Vec<(u32, u32)>,
}

impl Slots {
    /// Empty slots for `triangles` triangles, at most `capacity` in each.
    pub(super) fn new(triangles: u64, capacity: usize) -> Self {
        let slots = triangles.div_ceil(capacity.max(1) as u64) as usize;
        Self { capacity: capacity as u32, filled: vec![(0, 0); slots] }
    }

    /// Number of slots.
    pub(super) fn len(&self) -> usize {
        self.filled.len()
    }

    /// Maximum number of triangles in a slot.
    pub(super) fn capacity(&self) -> u64 {
        self.capacity.into()
    }

    /// Number of the first triangle of a slot in the inputs.
    pub(super) fn first(&self, slot: usize) -> u64 {
        slot as u64 * self.capacity()
    }

    /// First byte of a slot in the file.
    pub(super) fn byte(&self, slot: usize, layout: Layout) -> u64 {
        self.first(slot) * 4 * layout.triangle() as u64
    }

    /// Write the corners of the kept triangles of a slot. Afterwards, `words` is in the byte order of the file.
    ///
    /// # Errors
    /// [`ScratchError`] if they cannot be written.
    pub(super) fn fill(
        &mut self,
        file: &ScratchFile,
        layout: Layout,
        slot: usize,
        words: &mut [u32],
    ) -> Result<(), ScratchError> {
        if !words.is_empty() {
            write_words(file, self.byte(slot, layout), words)?;
        }
        self.filled[slot] = ((words.len() / layout.triangle()) as u32, crc32fast::hash(bytemuck::cast_slice(words)));
        Ok(())
    }
}

/// Reads complete slots.
pub(super) struct Corners<'a> {
    file: ScratchFile,
    layout: Layout,
    slots: &'a Slots,
}

impl<'a> Corners<'a> {
    /// Open the file.
    ///
    /// # Errors
    /// [`ScratchError`] if it cannot be opened.
    pub(super) fn open(scratch: &Scratch, layout: Layout, slots: &'a Slots) -> Result<Self, ScratchError> {
        Ok(Self { file: scratch.existing(CORNERS)?, layout, slots })
    }

    /// Number of slots.
    pub(super) fn len(&self) -> usize {
        self.slots.len()
    }

    /// Read the corners of the triangles in a slot into `into`, replacing its contents. If there is no such slot, `into` is
    /// empty.
    ///
    /// # Errors
    /// [`ScratchError::Damaged`] if they are not what was written, [`ScratchError::Io`].
    pub(super) fn read(&self, slot: usize, into: &mut Vec<u32>) -> Result<(), ScratchError> {
        let Some((triangles, crc32)) = self.slots.filled.get(slot).copied() else {
            into.clear();
            return Ok(());
        };
        into.resize(triangles as usize * self.layout.triangle(), 0);
        let (at, mut sum) = (self.slots.byte(slot, self.layout), crc32fast::Hasher::new());
        read_words_with_sum(&self.file, at, into, &mut sum)?;
        if sum.finalize() == crc32 {
            return Ok(());
        }
        Err(ScratchError::damaged(
            self.file.path(),
            format!("the checksum of the triangles at byte {at} does not match"),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAYOUT: Layout = Layout { colors: true, normals: false, scalars: 0 };

    #[test]
    fn slots_written_in_any_order_are_read_as_they_were_and_any_change_is_found() {
        let scratch = Scratch::temporary().unwrap();
        let file = scratch.create(CORNERS).unwrap();
        let mut slots = Slots::new(6 * 10 + 3, 10);
        assert_eq!((slots.len(), slots.first(6), slots.capacity()), (7, 60, 10));
        // Full slots, slots that are partly or completely empty, and a short last one.
        let counts = [10, 4, 0, 10, 10, 1, 3];
        let words = |slot: usize| -> Vec<u32> { (0..counts[slot] * 12).map(|i| (slot * 1000 + i) as u32).collect() };
        for slot in [3, 6, 0, 2, 5, 1, 4] {
            // Corners that are not complete may have been there before.
            write_words(&file, slots.byte(slot, LAYOUT), &mut vec![7; counts[slot] * 12]).unwrap();
            slots.fill(&file, LAYOUT, slot, &mut words(slot)).unwrap();
        }
        let corners = Corners::open(&scratch, LAYOUT, &slots).unwrap();
        let mut read = vec![9; 5];
        for slot in 0..corners.len() {
            corners.read(slot, &mut read).unwrap();
            assert_eq!(read, words(slot), "slot {slot}");
        }
        corners.read(corners.len(), &mut read).unwrap();
        assert!(read.is_empty());
        // Two slots of the same size change places.
        write_words(&file, slots.byte(0, LAYOUT), &mut words(3)).unwrap();
        write_words(&file, slots.byte(3, LAYOUT), &mut words(0)).unwrap();
        file.truncate(slots.byte(6, LAYOUT) + 5).unwrap();
        for slot in 0..corners.len() {
            let result = corners.read(slot, &mut read);
            assert_eq!(matches!(result, Err(ScratchError::Damaged { .. })), [0, 3, 6].contains(&slot), "slot {slot}");
        }
    }
}
