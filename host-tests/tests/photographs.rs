//! Real laser spots: the default tables, and the same tables with least-squares weights, against a
//! least-squares fit.
//!
//! The photographs are not part of the repository. Where they are absent the test says that it is skipped.

use std::io::Write as _;
use std::path::PathBuf;

use host_tests::accuracy::{centre_of, centre_with};
use host_tests::core_tables;
use phase_tables::{LEAST_SQUARES, gaussian};
use simulator::least_squares;
use simulator::photograph::Photograph;
use simulator::scene::quantise;
use slitrange::centre::tables::TableSet;
use slitrange::centre::{Estimator, RowCentre};
use slitrange::sensor_heads;

/// A twentieth of full scale: the noise of dimmer rows is a good part of what is compared.
const BRIGHT: f64 = 4095.0 / 20.0;

#[test]
fn centres_lie_near_the_least_squares_fit() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/laser-spots");
    if !folder.is_dir() {
        // Past the capture of a passing test's output.
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED: no photographs in {}",
            folder.display()
        );
        return;
    }
    let least_squares_tables = phase_tables::set(&gaussian, LEAST_SQUARES);
    let least_squares_tables = core_tables::borrow(&least_squares_tables);
    let least_squares_tables = TableSet::new(&least_squares_tables).expect("proven");
    for name in ["TEM00_200mm", "t-580mm", "t-hene"] {
        let photograph =
            Photograph::read(folder.join(format!("{name}.pgm"))).expect("a photograph");
        let (mut default, mut least_squares) = (vec![], vec![]);
        for y in 0..photograph.height() {
            let Some((a, b)) = off(&photograph, y, &least_squares_tables) else {
                continue;
            };
            default.push(a);
            least_squares.push(b);
        }
        for (tables, offs, limit) in [
            ("r = 0.23", &default, 0.02),
            ("r = infinity", &least_squares, 0.002),
        ] {
            let rms = (offs.iter().map(|off| off * off).sum::<f64>() / offs.len() as f64).sqrt();
            let largest = offs
                .iter()
                .fold(0.0f64, |largest, off| largest.max(off.abs()));
            println!(
                "{name}, {tables}: {} rows, {rms:.5} sigma RMS, {largest:.5} at most",
                offs.len()
            );
            assert!(offs.len() >= 80 && rms <= limit, "{name}, {tables}: {rms}");
        }
    }
}

/// How far the centres of a row by the default and by other tables lie from the fit, in sigma; `None` for a
/// row without a bright spot, or with one that the picture's edge cuts.
fn off(photograph: &Photograph, y: usize, other: &TableSet<'_>) -> Option<(f64, f64)> {
    let geometry = sensor_heads::tcd1304dg();
    let (light, first) = photograph.on_sensor(y)?;
    let light = quantise(&light, geometry.full_scale());
    let first = usize::try_from(first).expect("narrower than the sensor");
    let picture: Vec<f64> = light[first..][..photograph.width()]
        .iter()
        .map(|&count| f64::from(count))
        .collect();
    let centre = centre_of(&geometry, &light, Estimator::PhaseTable)
        .ok()
        .filter(|centre| centre.amplitude.to_f64() >= BRIGHT)?;
    let in_picture = |centre: RowCentre| centre.centre.to_f64() - first as f64;
    let fit = least_squares::fit_near(&picture, in_picture(centre))?;
    let other =
        centre_with(other, None, &geometry, &light).expect("a centre by the other tables too");
    fit.is_whole_in(picture.len()).then(|| {
        (
            (in_picture(centre) - fit.centre) / fit.width,
            (in_picture(other) - fit.centre) / fit.width,
        )
    })
}

#[test]
fn rows_are_seldom_flagged() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/laser-spots");
    let geometry = sensor_heads::tcd1304dg();
    for name in ["TEM00_200mm", "t-580mm", "t-hene"] {
        let photograph =
            Photograph::read(folder.join(format!("{name}.pgm"))).expect("a photograph");
        let (mut rows, mut flagged, mut within, mut shapes, mut faults, mut ratio) =
            (0, 0, 0, vec![], 0, vec![]);
        for y in 0..photograph.height() {
            let Some((light, first)) = photograph.on_sensor(y) else {
                continue;
            };
            let light = quantise(&light, geometry.full_scale());
            let first = usize::try_from(first).expect("narrower than the sensor");
            let picture: Vec<f64> = light[first..][..photograph.width()]
                .iter()
                .map(|&count| f64::from(count))
                .collect();
            let row = slitrange::row::Row::new(&light, &[], 4095).unwrap();
            let found = slitrange::spot::find(&row).and_then(|spot| {
                slitrange::check::centre(Estimator::PhaseTable, &row, &spot, None, &geometry, None)
            });
            let found = match found {
                Ok(f) => f,
                Err(_) => {
                    faults += 1;
                    continue;
                }
            };
            if found.amplitude.to_f64() < BRIGHT {
                continue;
            }
            let Some(fit) = least_squares::fit_near(&picture, found.centre.to_f64() - first as f64)
            else {
                continue;
            };
            if !fit.is_whole_in(picture.len()) {
                continue;
            }
            rows += 1;
            flagged += usize::from(found.misfit);
            let error = found.centre.to_f64() - first as f64 - fit.centre;
            let shape = found.shape.uncertainty(None).to_f64();
            let u = found.uncertainty.to_f64().hypot(shape);
            within += usize::from(error.abs() <= 2.0 * u);
            shapes.push(shape / fit.width);
            ratio.push(error / u);
            if rows % 40 == 1 {
                let n = found.shape.noise.to_f64();
                println!(
                    "   w {:.1} h {:.0} error {error:.3} u {u:.3} r {:.4} flag {} rest {:.2} comps {:.1?}",
                    found.width.to_f64(),
                    found.amplitude.to_f64(),
                    found.uncertainty.to_f64(),
                    found.misfit,
                    found.shape.rest.to_f64() / n,
                    found.shape.components.map(|c| c.to_f64() / n)
                );
            }
        }
        shapes.sort_by(f64::total_cmp);
        let rms = (ratio.iter().map(|r| r * r).sum::<f64>() / rows as f64).sqrt();
        println!(
            "{name}: {rows} rows, {faults} faults, {flagged} flagged, {within} within 2u, median shape {:.4} widths, error/u {rms:.3}",
            shapes[shapes.len() / 2]
        );
    }
}
