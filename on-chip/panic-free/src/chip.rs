//! All that exists only on the chip: the program, and what it does in place of a panic.

mod any;
mod whole_core;

use core::ffi::c_void;
use core::panic::PanicInfo;

/// Where the linker starts to look for what is reachable.
#[unsafe(no_mangle)]
extern "C" fn _start() -> ! {
    whole_core::measure_rows();
    whole_core::find_centres();
    whole_core::correct_pixels();
    whole_core::find_distances();
    whole_core::make_numbers();
    whole_core::talk();
    loop {
        core::hint::spin_loop();
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    unsafe extern "C" {
        safe fn a_panic_is_reachable(place: *const c_void) -> !;
    }
    // The place is passed on so that it is in the program where a panic is, and can be named.
    a_panic_is_reachable(
        info.location()
            .map_or(core::ptr::null(), |place| (&raw const *place).cast()),
    )
}
