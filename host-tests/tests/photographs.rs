//! Real laser spots: the default tables, and the same tables with least-squares weights, against a
//! least-squares fit.
//!
//! The photographs are not part of the repository. Where they are absent the test says that it is skipped.

use crate::support::*;
use phase_tables::{LEAST_SQUARES, gaussian};
use simulator::photograph::Photograph;
use std::path::Path;

/// A twentieth of full scale: the noise of dimmer rows is a good part of what is compared.
const BRIGHT: f64 = 4095.0 / 20.0;

fn photographs(folder: &Path) -> impl Iterator<Item = (&'static str, Photograph)> {
    let names = ["TEM00_200mm", "t-580mm", "t-hene"].into_iter();
    names.map(|name| {
        let photograph = Photograph::read(folder.join(format!("{name}.pgm")));
        (name, photograph.expect("a photograph"))
    })
}

#[test]
fn centres_lie_near_the_least_squares_fit() {
    let Some(folder) = shared_data("laser-spots") else {
        return;
    };
    let least_squares_tables = phase_tables::set(&gaussian, LEAST_SQUARES);
    let least_squares_tables = core_tables::borrow(&least_squares_tables);
    let least_squares_tables = TableSet::new(&least_squares_tables).expect("proven");
    for (name, photograph) in photographs(&folder) {
        let offs =
            (0..photograph.height).filter_map(|y| off(&photograph, y, &least_squares_tables));
        let (default, least_squares): (Vec<f64>, Vec<f64>) = offs.unzip();
        for (tables, offs, limit) in [
            ("r = 0.23", &default, 0.02),
            ("r = infinity", &least_squares, 0.002),
        ] {
            let rms = statistics::rms(offs);
            let (rows, largest) = (offs.len(), judges::accuracy::largest(offs));
            println!("{name}, {tables}: {rows} rows, {rms:.5} sigma RMS, {largest:.5} at most");
            assert!(rows >= 80 && rms <= limit, "{name}, {tables}: {rms}");
        }
    }
}

/// A row on the sensor, the pixel on which the picture begins, and the picture's own part of the row.
fn row(photograph: &Photograph, y: usize) -> Option<(Vec<u16>, usize, Vec<f64>)> {
    let (light, first) = photograph.on_sensor(y)?;
    let light = quantise(&light, sensor_heads::tcd1304dg().full_scale());
    let first = usize::try_from(first).expect("narrower than the sensor");
    let picture = &light[first..][..photograph.width];
    let picture = picture.iter().map(|&count| f64::from(count)).collect();
    Some((light, first, picture))
}

/// How far the centres of a row by the default and by other tables lie from the fit, in sigma; `None` for a
/// row without a bright spot, or with one that the picture's edge cuts.
fn off(photograph: &Photograph, y: usize, other: &TableSet<'_>) -> Option<(f64, f64)> {
    let geometry = sensor_heads::tcd1304dg();
    let (light, first, picture) = row(photograph, y)?;
    let centre = centre_of(&geometry, &light, Estimator::PhaseTable).ok();
    let centre = centre.filter(|centre| centre.amplitude.to_f64() >= BRIGHT)?;
    let in_picture = |centre: RowCentre| centre.centre.to_f64() - first as f64;
    let fit = least_squares::fit_near(&picture, in_picture(centre))?;
    let other = centre_with(other, None, &geometry, &light);
    let other = other.expect("a centre by the other tables too");
    let off = |centre| (in_picture(centre) - fit.centre) / fit.width;
    let is_whole = fit.is_whole_in(picture.len());
    is_whole.then(|| (off(centre), off(other)))
}

/// A real spot is lopsided. The check does not reject it: u says how far its centre is uncertain.
#[test]
fn few_rows_are_flagged_and_centres_lie_within_two_uncertainties_of_the_fit() {
    let Some(folder) = shared_data("laser-spots") else {
        return;
    };
    let geometry = sensor_heads::tcd1304dg();
    for (name, photograph) in photographs(&folder) {
        // Each row: error over uncertainty, the shape's part of it in widths, whether it has a flag.
        let rows = (0..photograph.height).filter_map(|y| {
            let (light, first, picture) = row(&photograph, y)?;
            let found = checked(&geometry, &light, Estimator::PhaseTable).ok()?;
            if found.amplitude.to_f64() < BRIGHT {
                return None;
            }
            let place = found.centre.to_f64() - first as f64;
            let fit = least_squares::fit_near(&picture, place)?;
            let by_shape = found.shape.uncertainty(None).to_f64();
            let u = found.uncertainty.to_f64().hypot(by_shape);
            fit.is_whole_in(picture.len()).then(|| {
                let off = (place - fit.centre).abs() / u;
                (off, by_shape / fit.width, found.misfit)
            })
        });
        let rows: Vec<(f64, f64, bool)> = rows.collect();
        let share = |is: fn(&(f64, f64, bool)) -> bool| {
            rows.iter().filter(|row| is(row)).count() as f64 / rows.len() as f64
        };
        let (within, flagged) = (share(|row| row.0 <= 2.0), share(|row| row.2));
        let (n, shape) = (rows.len(), upper_median(rows.iter().map(|row| row.1)));
        println!("{name}: {n} rows, {within:.3} within 2u, {flagged:.3} flagged, shape {shape:.3}");
        assert!(n >= 80 && within >= 0.95 && flagged <= 0.1);
    }
}
