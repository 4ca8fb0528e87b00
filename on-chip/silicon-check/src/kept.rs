//! What this program keeps over the reset by the watchdog: RAM that no start clears.

use core::sync::atomic::{AtomicU32, Ordering};

/// After power-on, RAM holds anything. These words hold what this program wrote only beside this number.
const WRITTEN: u32 = 0x5111_C0DE;

/// The words, under a name that they keep in the ELF file: a test asks for fewer rows by them.
#[unsafe(no_mangle)]
#[unsafe(link_section = ".uninit.silicon_check")]
static KEPT: [AtomicU32; Word::COUNT] = [const { AtomicU32::new(0) }; Word::COUNT];

#[derive(Clone, Copy)]
pub enum Word {
    /// [`WRITTEN`] if the number of rows counts.
    RowsWritten,
    /// How many rows to check.
    Rows,
    /// [`WRITTEN`] while the program waits for the watchdog: then the words after this one count.
    Waits,
    /// For how long it waited, ms.
    Waited,
    Passed,
    Failed,
    Skipped,
}

impl Word {
    const COUNT: usize = 7;

    pub fn get(self) -> u32 {
        KEPT[self as usize].load(Ordering::Relaxed)
    }

    pub fn set(self, word: u32) {
        KEPT[self as usize].store(word, Ordering::Relaxed);
    }

    /// Whether this program wrote the words that this one stands for.
    pub fn is_written(self) -> bool {
        self.get() == WRITTEN
    }

    /// Notes that the words that this one stands for are written.
    pub fn set_written(self) {
        self.set(WRITTEN);
    }
}
