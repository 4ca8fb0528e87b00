//! Hanging the firmware at a function, for tests of the watchdog.
//!
//! The emulated flash is read-only for tests too (rigless's STM32F427 has no model of its array, so
//! `Session::flip_bits` refuses it), and a driver reaches memory but no register. So the core is wrapped: it stops
//! before the function's first instruction and goes on at an instruction `b .`, a jump to itself, that the firmware
//! has anyway (cortex-m-rt's default handlers). That is what a function that never returns looks like: interrupts are
//! still served, and only a reset gets the core out.

use std::collections::BTreeSet;

use rigless::image::Image;

/// The Thumb instruction `b .`.
const JUMP_TO_ITSELF: [u8; 2] = 0xE7FE_u16.to_le_bytes();

/// Where the firmware shall hang.
#[derive(Debug, Default)]
pub struct Hangs {
    /// The first instructions of the functions.
    pub(crate) at: BTreeSet<u64>,
    /// Where it goes on instead: the address of a `b .`.
    pub(crate) trap: u32,
}

/// The address of a `b .` in `image`.
pub(crate) fn find_trap(image: &Image) -> Option<u32> {
    image.segments().find_map(|(address, bytes)| {
        // Segments begin at whole words and an instruction at a whole halfword.
        let (halfwords, _) = bytes.as_chunks::<2>();
        let index = halfwords
            .iter()
            .position(|&halfword| halfword == JUMP_TO_ITSELF)?;
        u32::try_from(address + 2 * index as u64).ok()
    })
}
