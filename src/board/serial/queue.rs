//! A queue of bytes from one task to one interrupt.

use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering};

/// Holds `ROOM` - 1 bytes. One side pushes, the other pops. All its bytes are zero at first.
pub struct Queue<const ROOM: usize> {
    bytes: [AtomicU8; ROOM],
    /// The place of the next byte that is pushed, and of the next that is popped. Below `ROOM`, so no sum of
    /// these wraps.
    end: AtomicUsize,
    begin: AtomicUsize,
}

impl<const ROOM: usize> Queue<ROOM> {
    /// An empty queue.
    pub const fn new() -> Self {
        Self {
            bytes: [const { AtomicU8::new(0) }; ROOM],
            end: AtomicUsize::new(0),
            begin: AtomicUsize::new(0),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The bytes in it.
    pub fn len(&self) -> usize {
        let begin = self.begin.load(Ordering::Acquire);
        (self.end.load(Ordering::Acquire) + ROOM - begin) % ROOM
    }

    /// Takes all of the bytes or, without room for them, none.
    pub fn try_push(&self, bytes: &[u8]) -> bool {
        let mut end = self.end.load(Ordering::Relaxed);
        if bytes.len() >= ROOM - self.len() {
            return false;
        }
        for byte in bytes {
            self.bytes[end].store(*byte, Ordering::Relaxed);
            end = (end + 1) % ROOM;
        }
        self.end.store(end, Ordering::Release);
        true
    }

    pub fn pop(&self) -> Option<u8> {
        let begin = self.begin.load(Ordering::Relaxed);
        if begin == self.end.load(Ordering::Acquire) {
            return None;
        }
        let byte = self.bytes[begin].load(Ordering::Relaxed);
        self.begin.store((begin + 1) % ROOM, Ordering::Release);
        Some(byte)
    }
}
