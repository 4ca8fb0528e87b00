//! Makes the firmware hang or panic at a function, or jump to no memory, for tests of the watchdog.
//!
//! The emulated flash is read-only for tests too (rigless's STM32F427 has no model of its array, so
//! `Session::flip_bits` refuses it), and a driver reaches memory but no register. So `watched_core` wraps the
//! core. The wrapped core stops before the function's first instruction and continues at a jump to itself
//! (`b .`), which the firmware has anyway in cortex-m-rt's default handlers. This behaves like a function
//! that never returns: interrupts are still served, and only a reset ends it. For a panic, the core continues
//! at the function that the firmware calls to panic.

use std::collections::BTreeMap;

use rigless::image::Image;

/// The Thumb instruction `b .`.
const JUMP_TO_ITSELF: [u8; 2] = 0xE7FE_u16.to_le_bytes();

/// The function that panics without a message: `defmt::unwrap!` and the like call it after they have logged
/// theirs.
pub(crate) const PANIC: &str = "_defmt_panic";

/// Where the STM32F429 has no memory: a call is a fault.
pub(crate) const NO_MEMORY: u32 = 0x1800_0000;

/// For each function's first instruction, what happens there.
pub type Detours = BTreeMap<u64, Detour>;

/// What happens at a function's first instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Detour {
    /// Where the firmware continues: at a `b .`, or at `PANIC`.
    pub to: u32,
    /// Where its stack is from then on, if it moves. The next interrupt uses the stack.
    pub stack: Option<u32>,
}

pub(crate) fn find_trap(image: &Image) -> Option<u32> {
    image.segments().find_map(|(address, bytes)| {
        // Segments begin at whole words and an instruction at a whole halfword.
        let (halfwords, _) = bytes.as_chunks::<2>();
        let index = halfwords.iter().position(|&it| it == JUMP_TO_ITSELF)?;
        u32::try_from(address + 2 * index as u64).ok()
    })
}
