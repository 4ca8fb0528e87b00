//! What the core's types need, beside the figures of the crate's page, which are those of a 32-bit chip.

use slitrange::{Calibration, Geometry, Measured, Measurement, Options, Reading};

#[test]
fn types_fit_the_memory_that_the_crate_page_states() {
    // With pointers of 64 bits lengths take twice the room.
    let room_for_lengths = if size_of::<usize>() == 8 { 200 } else { 0 };
    for (name, size, stated) in [
        ("Measurement", size_of::<Measurement>(), 17_030),
        ("Calibration", size_of::<Calibration>(), 2144),
        (
            "FlatField",
            size_of::<slitrange::row::pixels::flat_field::FlatField>(),
            29_500,
        ),
        ("Measured", size_of::<Measured>(), 236),
        ("Reading", size_of::<Reading>(), 92),
        ("Geometry", size_of::<Geometry>(), 92),
        ("Options", size_of::<Options>(), 92),
    ] {
        println!("{name}: {size} bytes here, {stated} or less on the chip");
        assert!(size <= stated + room_for_lengths, "{name}: {size}");
    }
}
