//! Spots that the sensor's edge cuts: they are fitted at the bound of the pixels that remain, or are a fault.
//! No phase table measures a window that the edge cuts.

use crate::support::*;
use judges::accuracy::answers;

const ROWS: u64 = 2000;

/// A row of [`PIXELS`] with its spot's centre there.
fn light_of(cell: &Cell, row: u64, centre: f64) -> Vec<u16> {
    let scene = cell.scene_of(PIXELS);
    quantise(&scene.row_with_centre(row, centre, 1.0), 4095)
}

/// The place of a centre that is so far from the first pixel's middle, or from the last one's.
fn truth(from: f64, is_left: bool) -> f64 {
    match is_left {
        true => from,
        false => (PIXELS - 1) as f64 - from,
    }
}

/// What an estimator alone finds in a row, and what the measurement finds with it.
fn centres(cell: &Cell, light: &[u16], estimator: Estimator) -> [Answer; 2] {
    answers(&cell.scene_of(PIXELS).geometry(), light, estimator)
}

/// Two widths, one and none from the edge: within 1.2, 1.2 and 1.4 of the bound of the pixels that are left,
/// and as uncertain as claimed, to a tenth. The same at the other edge of the sensor.
fn check_cut_spots(noises: &[Noise], widths: &[f64]) {
    let mut failures = vec![];
    for (&noise, &width) in pairs(noises, widths) {
        let cell = cell(width, 2000.0, noise, ROWS, 11);
        let spot = cell.spot();
        for (widths, limit) in [(2.0, 1.2), (1.0, 1.2), (0.0, 1.4)] {
            // From the first pixel's middle, over the phases evenly.
            let from_edge = |row: u64| widths * width + (row as f64 * 0.618_033_988_75).fract();
            for side in ["left", "right"] {
                let found = |row: u64| {
                    let from = from_edge(row);
                    let truth = truth(from, side == "left");
                    let light = light_of(&cell, row, truth);
                    let [_, found] = centres(&cell, &light, Estimator::GaussNewton);
                    let (found, bound) = (found.ok()?, spot.bound_cut(from));
                    let error = found.centre.to_f64() - truth;
                    Some([error, bound, found.uncertainty.to_f64()])
                };
                let found: Vec<[f64; 3]> = (0..ROWS).into_par_iter().filter_map(found).collect();
                let rmse = rms(found.iter().map(|[error, ..]| error));
                let bound = rms(found.iter().map(|[_, bound, _]| bound));
                let pull = rms(found.iter().map(|[error, _, claim]| error / claim));
                let faults = ROWS - found.len() as u64;
                let ratio = rmse / bound;
                println!(
                    "noise {noise:?}, sigma {width:>4}, {widths} widths from the {side:>5}: {rmse:.4} px, \
                     {ratio:.2} of the bound {bound:.4}, {pull:.2} of the claim; {faults} faults"
                );
                let is_honest = (pull - 1.0).abs() <= 0.1;
                // Noise takes some centres near the edge beyond it: faults.
                let most = if widths == 0.0 { ROWS / 10 } else { 0 };
                if ratio > limit || !is_honest || faults > most {
                    failures.push((noise, width, widths, side));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}

#[test]
fn a_cut_spot_is_fitted_at_its_own_bound() {
    check_cut_spots(&[(2.0, Some(5.0))], &[3.0, 10.5]);
}

#[test]
#[ignore = "all noises and widths; takes 17 CPU s; run by .ci/run"]
fn a_cut_spot_of_any_width_is_fitted_at_its_own_bound() {
    check_cut_spots(&[(2.0, Some(5.0)), (20.0, None)], &[1.5, 3.0, 10.5, 30.0]);
}

/// If the centre is beside the sensor, by 0.1 to two widths, every estimator gives a fault.
#[test]
fn a_spot_beside_the_sensor_is_a_fault() {
    for width in [1.5, 4.0, 10.5, 30.0] {
        let cell = cell(width, 2000.0, (2.0, Some(5.0)), 0, 11);
        for row in 0..400 {
            let beside = -0.5 - width * (0.1 + 2.0 * row as f64 / 400.0);
            let light = light_of(&cell, row, beside);
            for (light, estimator) in pairs([mirrored(&light), light], Estimator::ALL) {
                for found in centres(&cell, &light, estimator) {
                    let case = format!("{estimator:?}, {width} at {beside}");
                    assert!(found.is_err(), "{case}: {found:?}");
                }
            }
        }
    }
}

/// Takes spots of 0.8 to 100 pixels, from four widths beyond the edge to five widths inside, 20,000 rows an
/// estimator. No table measures a window that the edge cuts (the narrowest possible window reaches three
/// widths). No centre is off by more than five times its claim plus 0.05 pixel.
#[test]
fn cut_windows_use_no_table_and_give_no_confident_error() {
    let mut failures = vec![];
    for estimator in Estimator::ALL {
        let is_table = !matches!(estimator, Estimator::Centroid | Estimator::GaussNewton);
        // Each row's widths from the edge, whether the estimator alone has a centre, and confident errors.
        let rows = (0..20_000u64).into_par_iter().map(|seed| {
            let random = &mut random(seed);
            let width = 0.8 * f64::powf(125.0, random.random_range(0.0..1.0));
            let amplitude = random.random_range(100.0..3000.0);
            let noise = (4.0, random.random_bool(0.5).then_some(10.0));
            let cell = cell(width, amplitude, noise, 0, seed);
            let widths = random.random_range(-4.0..5.0);
            let truth = truth(widths * cell.width, random.random_bool(0.5));
            let found = centres(&cell, &light_of(&cell, seed, truth), estimator);
            let is_confident_error =
                |found: &Answer| Said::of_row(Truth::Centre(truth), found).is_confident_error();
            let is_wrong = found.iter().any(is_confident_error);
            (widths, found[0].is_ok(), is_wrong)
        });
        let rows: Vec<(f64, bool, bool)> = rows.collect();
        let with_centre = rows.iter().filter(|row| row.1).map(|row| row.0);
        let nearest = with_centre.clone().fold(f64::INFINITY, f64::min);
        let wrong = rows.iter().filter(|row| row.2).count();
        let (name, centres) = (estimator.name(), with_centre.count());
        println!("{name:>14}: {centres} centres from {nearest:.2} widths on; {wrong} wrong");
        if wrong > 0 || (is_table && nearest < 3.0) {
            failures.push(estimator);
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}
