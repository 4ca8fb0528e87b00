//! The search for the spot, and turning words into a row.

use cost_on_chip::rows::{self, PIXELS, ROWS, Turn, WORDS};
use slitrange::spot::{self, Spot};
use slitrange::{Fault, Geometry, Pixels, Row};

use super::counter::{self, Cost};

/// The width of the spot on the rows that are searched.
const WIDTH: f32 = 10.5;

/// Counts each step on [`ROWS`] rows.
pub fn measure() {
    let geometry = rows::geometry();
    let mut pixels = [0; PIXELS];
    let mut words = [0; WORDS];
    let (mut turning, mut search, mut search_again) = (none(), none(), none());
    for row in 0..ROWS {
        rows::light(WIDTH, row, Turn::Now, &mut pixels);

        rows::words(&pixels, &mut words);
        let mut read_out = ReadOut {
            words: &mut words,
            is_row: false,
        };
        turning[row] = counter::count(step_geometry_row, &geometry, &mut read_out);
        defmt::assert!(read_out.is_row);

        let light = defmt::unwrap!(Row::new(&pixels, &[], geometry.saturated_from()).ok());
        let mut spot = None;
        search[row] = counter::count(step_spot_find, &light, &mut spot);
        let first = defmt::unwrap!(spot.take().and_then(Result::ok));
        let before = Before {
            spot: first,
            width: Pixels::from_f32(WIDTH),
        };
        search_again[row] = counter::count(step_spot_find_again, &(light, before), &mut spot);
        defmt::assert!(matches!(spot, Some(Ok(found)) if found.centre.abs_diff(first.centre) < 16));
    }
    // What each step goes over.
    let (words, pixels) = (("items", WORDS as f32), ("items", PIXELS as f32));
    counter::print("step", "geometry-row", words, turning);
    counter::print("step", "spot-find", pixels, search);
    counter::print("step", "spot-find-again", pixels, search_again);
}

fn none() -> [Cost; ROWS] {
    [Cost::default(); ROWS]
}

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn step_spot_find(row: &Row<'_>, spot: &mut Option<Result<Spot, Fault>>) {
    *spot = Some(spot::find(row).map(|(spot, _)| spot));
}

/// What the row before knew of the spot.
struct Before {
    spot: Spot,
    width: Pixels,
}

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn step_spot_find_again(
    (row, before): &(Row<'_>, Before),
    spot: &mut Option<Result<Spot, Fault>>,
) {
    *spot = Some(spot::find_again(row, &before.spot, before.width).map(|(spot, _)| spot));
}

/// Words, and whether they were a row.
struct ReadOut<'a> {
    words: &'a mut [u16; WORDS],
    is_row: bool,
}

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn step_geometry_row(geometry: &Geometry, read_out: &mut ReadOut<'_>) {
    read_out.is_row = geometry.row(read_out.words).is_ok();
}
