//! The rows that everyone is given, and what the row before tells of each.

use anyhow::anyhow;
use judges::accuracy::Cell;
use simulator::scene::BlackLevel;
use slitrange::centre;
use slitrange::spot::{self, Spot};

use super::gaussian::{Parameters, WINDOW};
use crate::prelude::*;

/// Pixels of the row in which the spot is found. The search is in nobody's time.
const PIXELS: usize = 512;

/// 128 pixels around a spot, and what the row before told.
#[derive(Clone, Debug)]
pub struct Window {
    pub pixels: [u16; WINDOW],
    /// The spot's true centre, pixel 0 being the window's first.
    pub truth: f64,
    /// The spot as the search found it, on the window.
    pub spot: Spot,
    /// What the default estimator found in the row before, on this window.
    pub before: RowCentre,
    /// Where the peers start: what `phase-table` found in the row before.
    pub start: Parameters,
}

/// A spot of sigma 10.5 pixels and 2000 counts, the slit's on the paper's pixels, with shot noise and read
/// noise as a laser spot has them.
const CELL: Cell = Cell {
    width: 10.5,
    amplitude: 2000.0,
    read_noise: 2.0,
    electrons_per_count: Some(5.0),
    rows: 0,
    seed: 1,
};

/// A whole row. Its unlit pixels have so many counts that noise does not go below zero.
fn whole_row() -> Scene {
    let mut scene = CELL.scene_of(PIXELS);
    scene.black_level = Some(BlackLevel::steady(100.0));
    scene
}

pub fn geometry() -> Geometry {
    with(whole_row().geometry(), |it| {
        (it.words, it.light) = (WINDOW, 0..WINDOW)
    })
}

/// The Cramér-Rao bound of a row's centre, in pixels, from pixels within 6 sigma: the window has 6.1 to
/// either side.
pub fn bound() -> f64 {
    CELL.spot().bound()
}

/// Seeded windows; the spot lies at all phases of a pixel, and is found in each.
pub fn windows(rows: usize) -> anyhow::Result<Vec<Window>> {
    let scene = whole_row();
    (0..rows as u64)
        .into_par_iter()
        .map(|row| window(&scene, row).with_context(|| format!("row {row}")))
        .collect()
}

/// A number of -1 to 1, evenly over the rows; `irrational` keeps the sequences apart.
fn even(row: u64, irrational: f64) -> f64 {
    2.0 * (row as f64 * irrational).fract() - 1.0
}

/// The row before has the spot up to half a pixel away, up to 5 % narrower or wider, and up to 10 % lower or
/// higher.
fn window(scene: &Scene, row: u64) -> anyhow::Result<Window> {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let truth = PIXELS as f64 / 2.0 + 10.0 * even(row, GOLDEN);
    let mut earlier = scene.clone();
    if let Some(spot) = &mut earlier.spot {
        spot.width *= 1.0 + 0.05 * even(row, std::f64::consts::SQRT_2);
        spot.counts_per_second *= 1.0 + 0.1 * even(row, 3f64.sqrt());
    }
    let moved = truth + 0.5 * even(row, 7f64.sqrt());
    let full_scale = scene.geometry().full_scale();
    let earlier = quantise(&earlier.row_with_centre(2 * row, moved, 1.0), full_scale);
    let words = quantise(&scene.row_with_centre(2 * row + 1, truth, 1.0), full_scale);

    let earlier = Row::new(&earlier, &[], 4095).map_err(|error| anyhow!("{error:?}"))?;
    let (earlier_spot, _) = spot::find(&earlier).map_err(|fault| anyhow!("{fault:?}"))?;
    let found = |estimator| {
        centre::centre(estimator, &earlier, &earlier_spot, None, &scene.geometry())
            .map_err(|fault| anyhow!("{fault:?}"))
    };
    let (before, of_default) = (found(Estimator::PhaseTable)?, found(Estimator::default())?);
    let first = before.centre.to_f64().round() as usize - WINDOW / 2;
    let first_bits = Pixels::from_int(first as i32).to_bits();
    let on_window = |found: RowCentre| RowCentre {
        centre: Pixels::from_bits(found.centre.to_bits() - first_bits),
        ..found
    };
    let before = on_window(before);

    let whole = Row::new(&words, &[], 4095).map_err(|error| anyhow!("{error:?}"))?;
    let (spot, _) = spot::find(&whole).map_err(|fault| anyhow!("{fault:?}"))?;
    Ok(Window {
        pixels: words[first..first + WINDOW].try_into()?,
        truth: truth - first as f64,
        spot: Spot {
            centre: spot.centre - first,
            ..spot
        },
        before: on_window(of_default),
        start: Parameters {
            amplitude: before.amplitude.to_f64(),
            centre: before.centre.to_f64(),
            scale: 1.0 / (before.width.to_f64() * std::f64::consts::SQRT_2),
            level: earlier_spot.background.level.to_f64(),
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_start_of_a_fit_is_near_the_truth() {
        // What the row before did not measure better, five standard deviations: the width's bound is
        // about that of the centre.
        let noise = 5.0 * bound();
        for window in windows(300).expect("a spot in each row") {
            let (start, truth) = (window.start, window.truth);
            let width = 1.0 / (start.scale * std::f64::consts::SQRT_2);
            assert!((start.centre - truth).abs() < 0.5 + noise, "{window:?}");
            assert!((width - 10.5).abs() < 0.05 * 10.5 + noise, "{window:?}");
            assert!((start.amplitude / 2000.0 - 1.0).abs() < 0.15, "{window:?}");
            assert!((truth - 64.0).abs() < 1.0 + noise, "{window:?}");
        }
    }
}
