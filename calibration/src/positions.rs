//! Distances at which to take the points of a calibration.

use std::fmt::Display;
use std::ops::RangeInclusive;

use anyhow::{Result, ensure};

/// What is as far from eq. (1)'s pole in pixels as the next, as near as can be said before it is known: that
/// of the nominal geometry, D of [`slitrange::distance::eq1::NOMINAL`] in millimetres.
const D_MM: f64 = -115.4;
/// The least and the largest distance that a record can hold, in millimetres, with a little to spare. The
/// stage's zero may be anywhere: where it is, eq. (1)'s D takes in.
const SENSIBLE_MM: RangeInclusive<f64> = -8380.0..=8380.0;
/// The step of a stage's distances, in millimetres.
pub const STAGE_MM: f64 = 0.001;

/// Checks that a record can hold a distance in millimetres, which the error shows as `shown`.
pub fn check(mm: f64, shown: impl Display) -> Result<()> {
    ensure!(
        SENSIBLE_MM.contains(&mm),
        "{shown} is no distance of a target: it is {} to {} mm",
        SENSIBLE_MM.start(),
        SENSIBLE_MM.end()
    );
    Ok(())
}

/// Positions from one end to the other in millimetres, at about even steps of the centre on a nominal sensor.
/// The ends stay as they are, and the others are multiples of `round`.
///
/// # Errors
/// The ends are no distances from the laser's origin, or the positions are too close together.
pub fn even_pixels(from: f64, to: f64, points: usize, round: f64) -> Result<Vec<f64>> {
    for end in [from, to] {
        check(end, format_args!("{end} mm"))?;
        ensure!(
            end > D_MM,
            "{end} mm is no distance from the laser's origin, which even pixels are reckoned from: give \
             --spacing distance"
        );
    }
    let (first, last) = (1.0 / (from - D_MM), 1.0 / (to - D_MM));
    let at = |part: f64| D_MM + 1.0 / (first + (last - first) * part);
    spread(from, to, points, round, at)
}

/// The same at even steps of the distance.
///
/// # Errors
/// The ends are no distances of a target, or the positions are too close together.
pub fn even_distances(from: f64, to: f64, points: usize, round: f64) -> Result<Vec<f64>> {
    for end in [from, to] {
        check(end, format_args!("{end} mm"))?;
    }
    spread(from, to, points, round, |part| from + (to - from) * part)
}

/// Positions from one end to the other, where `at` gives one for each part of the way.
fn spread(
    from: f64,
    to: f64,
    points: usize,
    round: f64,
    at: impl Fn(f64) -> f64,
) -> Result<Vec<f64>> {
    let most = ((to - from).abs() / round) as usize;
    let too_close = || {
        format!(
            "{points} positions from {from} to {to} mm: there must be at least 2, and {round} mm or more \
             apart; take fewer --points, or a finer --round"
        )
    };
    let is_count = (2..=most.max(2)).contains(&points);
    ensure!(is_count && from != to, too_close());
    let last = (points - 1) as f64;
    let position = |index| {
        let mm = at(index as f64 / last);
        let mm = match index {
            _ if index == 0 || index == points - 1 => mm,
            _ => (mm / round).round() * round,
        };
        // No digits that rounding made, and no -0.
        (mm / STAGE_MM).round() / (1.0 / STAGE_MM) + 0.0
    };
    let positions: Vec<f64> = (0..points).map(position).collect();
    let in_order = |pair: &[f64]| (pair[1] - pair[0]) * (to - from) > 0.0;
    ensure!(positions.windows(2).all(in_order), too_close());
    Ok(positions)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_even_on_the_sensor() {
        let even = even_pixels(600.0, 1020.0, 8, STAGE_MM).expect("positions");
        println!("{even:?}");
        assert_eq!((even[0], even[7]), (600.0, 1020.0));
        let nominal = slitrange::distance::eq1::NOMINAL.expect("a curve");
        let (d, k) = (nominal.d().to_f64() / 1e3, nominal.k() as f64 / 65_536e3);
        let pixels: Vec<f64> = even.iter().map(|mm| k / (mm - d)).collect();
        let steps: Vec<f64> = pixels.windows(2).map(|pair| pair[0] - pair[1]).collect();
        println!("{steps:?}");
        // 1519 px over seven steps; rounding to a micrometre is up to 0.006 px, twice.
        assert!(steps.iter().all(|step| (step - steps[0]).abs() < 0.05));
        let falling = even_pixels(1020.0, 600.0, 8, STAGE_MM).expect("positions");
        assert!(even.iter().eq(falling.iter().rev()));
        let even = even_distances(600.0, 1020.0, 3, STAGE_MM).expect("positions");
        assert_eq!(even, [600.0, 810.0, 1020.0]);
    }

    #[test]
    fn malformed_ends_are_refused() {
        for (from, to, points) in [
            (600.0, 600.0, 2),
            (600.0, 1020.0, 1),
            (-8381.0, 1020.0, 5),
            (600.0, f64::NAN, 5),
            (-115.4, 1020.0, 5),
            (600.0, 600.01, 20),
        ] {
            let error = even_pixels(from, to, points, STAGE_MM).expect_err("no positions");
            println!("{error:#}");
        }
    }

    #[test]
    fn the_zero_may_be_anywhere() {
        let even = even_distances(210.0, -210.0, 3, STAGE_MM).expect("positions");
        assert_eq!(even, [210.0, 0.0, -210.0]);
        assert!(even[1].is_sign_positive());
        let error = even_pixels(-210.0, 210.0, 3, STAGE_MM).expect_err("refused");
        assert!(error.to_string().ends_with("give --spacing distance"));
    }
}
