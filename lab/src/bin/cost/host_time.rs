//! Time per row on this computer, on one core.

use std::hint::black_box;
use std::time::Instant;

use cost_on_chip::methods::{self, Method};
use host_tests::accuracy::{Cell, PIXELS};
use simulator::scene::quantise;
use slitrange::row::Row;
use slitrange::spot;

const ROWS: u64 = 256;
const REPETITIONS: usize = 101;

/// Nanoseconds per row, the median of repetitions, for a spot of 10.5 pixels' width whose place is known from
/// the row before.
/// The search for the spot is not in it. `None` where a row has no centre.
pub fn nanoseconds(method: Method) -> Option<f64> {
    let cell = Cell {
        width: 10.5,
        amplitude: 2000.0,
        read_noise: 2.0,
        electrons_per_count: Some(5.0),
        rows: ROWS,
        seed: 4,
    };
    let scene = cell.scene_of(PIXELS);
    let geometry = scene.geometry();
    let counts: Vec<Vec<u16>> = (0..ROWS)
        .map(|row| {
            let centre = PIXELS as f64 / 2.0 + row as f64 / ROWS as f64;
            quantise(&scene.row_with_centre(row, centre, 1.0), 4095)
        })
        .collect();
    let mut rows = vec![];
    let mut before = None;
    for counts in &counts {
        let row = Row::new(counts, &[], 4095).ok()?;
        let spot = spot::find(&row).ok()?;
        let centre = methods::centre(method, &row, &spot, before.as_ref(), &geometry);
        rows.push((row, spot, before));
        before = Some(centre.ok()?);
    }
    let mut times: Vec<f64> = (0..REPETITIONS)
        .map(|_| {
            let start = Instant::now();
            for (row, spot, before) in &rows {
                let _ = black_box(methods::centre(
                    black_box(method),
                    black_box(row),
                    spot,
                    before.as_ref(),
                    &geometry,
                ));
            }
            start.elapsed().as_nanos() as f64 / rows.len() as f64
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times.get(REPETITIONS / 2).copied()
}
