//! Having the firmware hang or panic at a function, for tests of the watchdog.
//!
//! The emulated flash is read-only for tests too (rigless's STM32F427 has no model of its array, so
//! `Session::flip_bits` refuses it), and a driver reaches memory but no register. So the core is wrapped: it stops
//! before the function's first instruction and goes on at an instruction `b .`, a jump to itself, that the firmware
//! has anyway (cortex-m-rt's default handlers). That is what a function that never returns looks like: interrupts are
//! still served, and only a reset gets the core out. A panic is the same with another place to go on at: what the firmware calls to panic.

use std::collections::BTreeMap;

use rigless::image::Image;

/// The Thumb instruction `b .`.
const JUMP_TO_ITSELF: [u8; 2] = 0xE7FE_u16.to_le_bytes();

/// What panics without being told why: the function that `defmt::unwrap!` and the like call when they have said it.
pub(crate) const PANIC: &str = "_defmt_panic";

/// Where the firmware goes on instead of at the first instruction of a function: at a `b .`, or at `PANIC`.
pub type Detours = BTreeMap<u64, u32>;

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
