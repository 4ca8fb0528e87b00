//! Real laser spots: the default tables, and the same tables with least-squares weights, against a least-squares fit.
//!
//! The photographs are not part of the repository. Where they are absent the test says that it is skipped.

use std::io::Write as _;
use std::path::PathBuf;

use host_tests::accuracy::centre_of;
use host_tests::photograph::Photograph;
use host_tests::{core_tables, least_squares};
use phase_tables::gaussian;
use slitrange::estimator::tables::{GAUSSIAN, TableSet};
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
    let least_squares_tables = phase_tables::set(&gaussian, f64::INFINITY);
    let least_squares_tables = core_tables::borrow(&least_squares_tables);
    let least_squares_tables = TableSet::new(&least_squares_tables).expect("proven");
    for name in ["TEM00_200mm", "t-580mm", "t-hene"] {
        let photograph =
            Photograph::read(folder.join(format!("{name}.pgm"))).expect("a photograph");
        let (mut default, mut least_squares) = (vec![], vec![]);
        for row in photograph.rows() {
            let Some((a, b)) = off(row, photograph.white(), &least_squares_tables) else {
                continue;
            };
            default.push(a);
            least_squares.push(b);
        }
        for (tables, offs, limit) in [
            ("r = 0.3", &default, 0.02),
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

/// How far the centres of a row by the default and by other tables lie from the fit, in sigma; `None` for a row without a bright
/// spot, or with one that the picture's edge cuts.
fn off(row: &[u16], white: u16, other: &TableSet<'_>) -> Option<(f64, f64)> {
    let geometry = sensor_heads::tcd1304dg();
    let counts: Vec<u16> = row
        .iter()
        .map(|&value| (u32::from(value) * 4095 / u32::from(white)) as u16)
        .collect();
    let pixels: Vec<f64> = counts.iter().map(|&count| f64::from(count)).collect();
    // The picture stands at the start of the row; its last pixels, to and fro, fill the rest.
    let beside = counts[counts.len() - 32..]
        .iter()
        .cycle()
        .take(geometry.light.len() - counts.len());
    let light: Vec<u16> = counts.iter().chain(beside).copied().collect();
    let centre = centre_of(&geometry, &light, &GAUSSIAN)
        .ok()
        .filter(|centre| centre.amplitude.to_f64() >= BRIGHT)?;
    let fit = least_squares::fit_near(&pixels, centre.centre.to_f64(), 4.0)?;
    let whole =
        fit.centre >= 4.0 * fit.width && fit.centre + 4.0 * fit.width <= pixels.len() as f64 - 1.0;
    let other = centre_of(&geometry, &light, other).expect("a centre by the other tables too");
    whole.then(|| {
        (
            (centre.centre.to_f64() - fit.centre) / fit.width,
            (other.centre.to_f64() - fit.centre) / fit.width,
        )
    })
}
