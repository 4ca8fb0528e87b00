//! Time per row on this computer, on one core.

use std::hint::black_box;
use std::time::Instant;

use cost_on_chip::methods::{self, Method};
use judges::accuracy::{Cell, PIXELS};
use slitrange::Options;
use slitrange::frame::MAX_ROWS;
use slitrange::row::LARGEST_COUNT;
use slitrange::spot;

use crate::prelude::*;

const ROWS: u64 = 256;
const REPETITIONS: usize = 101;

const MOST: usize = MAX_ROWS as usize;

fn scene() -> (Scene, Vec<Vec<u16>>) {
    let cell = Cell {
        width: 10.5,
        amplitude: 2000.0,
        read_noise: 2.0,
        electrons_per_count: Some(5.0),
        rows: ROWS,
        seed: 4,
    };
    let scene = cell.scene_of(PIXELS);
    let row = |row| {
        let centre = PIXELS as f64 / 2.0 + row as f64 / ROWS as f64;
        quantise(&scene.row_with_centre(row, centre, 1.0), LARGEST_COUNT)
    };
    let counts = (0..ROWS).map(row).collect();
    (scene, counts)
}

/// Nanoseconds of a whole row that follows another of its frame, from its words to its centre with its check:
/// the median over rows with the words of the TCD1304DG. `None` where a row has no centre.
pub fn row_nanoseconds(estimator: Estimator) -> Option<f64> {
    let (_, counts) = scene();
    let geometry = sensor_heads::tcd1304dg();
    let full_scale = geometry.full_scale();
    let rows: Vec<Vec<u16>> = counts
        .iter()
        .map(|counts| {
            let dark = counts.iter().min().copied().unwrap_or_default();
            let mut words = vec![full_scale - dark; geometry.words];
            let before = (geometry.light.len() - counts.len()) / 2;
            let lit = &mut words[geometry.light.start + before..];
            for (word, count) in lit.iter_mut().zip(counts) {
                *word = full_scale - count;
            }
            words
        })
        .collect();
    let options = with(Options::default(), |it| {
        (it.estimator, it.rows) = (estimator, MOST as u16)
    });
    let mut times = vec![];
    for _ in 0..REPETITIONS / 8 {
        for rows in rows.chunks(MOST) {
            let mut measurement = Measurement::new(geometry.clone(), options);
            for (place, words) in rows.iter().enumerate().take(MOST - 1) {
                let mut words = words.clone();
                let start = Instant::now();
                let measured = black_box(measurement.row(black_box(&mut words)));
                let time = start.elapsed().as_nanos() as f64;
                if measured.is_some() {
                    return None;
                }
                if place > 0 {
                    times.push(time);
                }
            }
        }
    }
    Some(upper_median(times))
}

/// Nanoseconds per row, the median of repetitions, for a spot whose place is known from the row before. The
/// search for the spot is not in it. `None` where a row has no centre.
pub fn nanoseconds(method: Method) -> Option<f64> {
    let (scene, counts) = scene();
    let geometry = scene.geometry();
    let mut rows = vec![];
    let mut before = None;
    for counts in &counts {
        let row = Row::new(counts, &[], 4095).ok()?;
        let (spot, _) = spot::find(&row).ok()?;
        let centre = methods::centre(method, &row, &spot, before.as_ref(), &geometry);
        rows.push((row, spot, before));
        before = Some(centre.ok()?);
    }
    let times = (0..REPETITIONS).map(|_| {
        let start = Instant::now();
        for (row, spot, before) in &rows {
            let (method, row, before) = (black_box(method), black_box(row), before.as_ref());
            let _ = black_box(methods::centre(method, row, spot, before, &geometry));
        }
        start.elapsed().as_nanos() as f64 / rows.len() as f64
    });
    Some(upper_median(times))
}
