//! What the device's types need, beside the figures of the crate's page, which are those of a 32-bit chip.

use slitrange_device::Settings;
use slitrange_device::record::Record;
use slitrange_device::session::Session;

#[test]
fn types_fit_the_memory_that_the_crate_page_states() {
    // With pointers of 64 bits lengths take twice the room.
    let room_for_lengths = if size_of::<usize>() == 8 { 200 } else { 0 };
    for (name, size, stated) in [
        ("Record", size_of::<Record>(), 2912),
        ("Session", size_of::<Session>(), 10_330),
        ("Settings", size_of::<Settings>(), 92),
    ] {
        println!("{name}: {size} bytes here, {stated} or less on the chip");
        assert!(size <= stated + room_for_lengths, "{name}: {size}");
    }
}
