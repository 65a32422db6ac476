//! Some words that one thread writes and others read whole, without either waiting for the other.
//!
//! A sequence lock: the version is odd while the words are written. The words are atomics, so a torn read is noticed and
//! thrown away, never undefined (H.-J. Boehm, Can seqlocks get along with programming language memory models?, 2012).

use std::sync::atomic::{AtomicU64, Ordering, fence};

/// Words with the number of their last writing.
#[derive(Debug)]
pub(crate) struct Words<const N: usize> {
    version: AtomicU64,
    words: [AtomicU64; N],
}

impl<const N: usize> Default for Words<N> {
    fn default() -> Self {
        Self { version: AtomicU64::new(0), words: [const { AtomicU64::new(0) }; N] }
    }
}

impl<const N: usize> Words<N> {
    /// Writes all words as the writing of this number, which is above 0. For one writer at a time; wait-free.
    pub(crate) fn write(&self, number: u64, words: [u64; N]) {
        self.version.store(2 * number - 1, Ordering::Relaxed);
        fence(Ordering::Release);
        for (place, word) in self.words.iter().zip(words) {
            place.store(word, Ordering::Relaxed);
        }
        self.version.store(2 * number, Ordering::Release);
    }

    /// The words with the number of their writing; none before the first, or while they are being written.
    pub(crate) fn read(&self) -> Option<(u64, [u64; N])> {
        let version = self.version.load(Ordering::Acquire);
        if version == 0 || version % 2 == 1 {
            return None;
        }
        let words = std::array::from_fn(|k| self.words[k].load(Ordering::Relaxed));
        fence(Ordering::Acquire);
        (self.version.load(Ordering::Relaxed) == version).then_some((version / 2, words))
    }

    /// Number of the last writing that has ended or begun; 0 before the first. Cheap.
    pub(crate) fn number(&self) -> u64 {
        self.version.load(Ordering::Relaxed).div_ceil(2)
    }
}
