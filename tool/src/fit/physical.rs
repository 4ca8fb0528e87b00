//! The paper's four parameters, d0, u, b and f, from the three that data give and one that is known.
//!
//! For any t = tan u, f = -xp t, b = -K t/(xp (1 + t^2)) and d0 = D + b/t are the same curve (xp from the
//! pixel on the optical
//! axis). So one of the four must be given. Where it is the baseline b, t and 1/t do as well as one another,
//! and which it is must be
//! said, too.
//!
//! The optical axis is taken to meet the middle of the row: where it does not, xp is off by as much, and all
//! four with it.

use anyhow::{bail, ensure};
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;
use slitrange::sensor_heads::tcd1304dg;

use super::eq1::Fit;

/// What is known beforehand. Lengths in millimetres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Constraint {
    /// b, with u above 45 degrees (steep) or below.
    Baseline(f64, Branch),
    /// tan u.
    TanU(f64),
    /// f.
    FocalLength(f64),
    /// d0.
    Offset(f64),
}

/// Which of two angles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Branch {
    /// u above 45 degrees, tan u above 1
    Steep,
    /// u below 45 degrees, tan u below 1
    Shallow,
}

/// A parameter with its standard uncertainty, where that is known. One that was given has none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Value {
    /// Itself.
    pub value: f64,
    /// Its standard uncertainty.
    pub uncertainty: Option<f64>,
}

/// The paper's parameters.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Physical {
    /// What was given.
    pub constraint: String,
    /// d0.
    pub d0_mm: Value,
    /// tan u.
    pub tan_u: Value,
    /// u.
    pub u_degrees: Value,
    /// b.
    pub b_mm: Value,
    /// f.
    pub f_mm: Value,
    /// The pixels are counted against the paper's x.
    pub mirrored: bool,
}

/// Pitch of the pixels of a TCD1304DG in millimetres (data sheet).
const PITCH_MM: f64 = 8e-3;

/// Why there are no four parameters without a constraint.
pub const UNCONSTRAINED: &str = "d0, u, b and f cannot be told from points: for any angle u there are d0, b and f with the very same curve. \
     Say which of them you know: --baseline MM with --branch, --tan-u T, --focal-length MM or --d0 MM";

/// Why the baseline alone is not enough.
const WHICH: &str = "with the baseline given there are two solutions, tan u and its inverse, with the very same curve: say which, --branch \
     steep (u above 45 degrees) or --branch shallow";

/// The constraint that options name.
///
/// # Errors
/// None or half of one is named.
pub fn constraint(
    baseline: Option<f64>,
    branch: Option<Branch>,
    tan_u: Option<f64>,
    focal_length: Option<f64>,
    offset: Option<f64>,
) -> anyhow::Result<Constraint> {
    Ok(match (baseline, tan_u, focal_length, offset) {
        (Some(baseline), ..) => match branch {
            Some(branch) => Constraint::Baseline(baseline, branch),
            None => bail!(WHICH),
        },
        (_, Some(tan_u), ..) => Constraint::TanU(tan_u),
        (_, _, Some(focal_length), _) => Constraint::FocalLength(focal_length),
        (.., Some(offset)) => Constraint::Offset(offset),
        _ => bail!(UNCONSTRAINED),
    })
}

impl Physical {
    /// The four parameters. `variance` is what the fit's covariance is to be multiplied with, where that is
    /// known.
    ///
    /// # Errors
    /// No sensor with what is given has that curve.
    pub fn of(fit: &Fit, constraint: Constraint, variance: Option<f64>) -> anyhow::Result<Self> {
        let curve = fit.curve;
        // In millimetres. Turned over where the distance rises with the pixels, so that K > 0 as in the
        // paper.
        let mirrored = curve.k < 0.0;
        let sign = if mirrored { -1.0 } else { 1.0 };
        let axis = (tcd1304dg().light.len() as f64 - 1.0) / 2.0;
        let found = Vector3::new(
            curve.d * 1e3,
            sign * curve.k * 1e3 * PITCH_MM,
            sign * (curve.pole - axis) * PITCH_MM,
        );
        let units = Vector3::new(1e3, sign * 1e3 * PITCH_MM, sign * PITCH_MM);
        let [d0, t, b, f] = four(&found, constraint)?;
        let uncertainty = |of: &dyn Fn([f64; 4]) -> f64| -> Option<f64> {
            let covariance: Matrix3<f64> = Matrix3::from_diagonal(&units)
                * fit.unit_covariance
                * Matrix3::from_diagonal(&units)
                * variance?;
            // Central differences over a hundredth of each parameter's uncertainty, to which the four are
            // straight.
            let mut gradient = Vector3::zeros();
            for i in 0..3 {
                let step = 0.01 * covariance[(i, i)].sqrt();
                let mut ends = [found; 2];
                ends[0][i] -= step;
                ends[1][i] += step;
                let [low, high] = [
                    four(&ends[0], constraint).ok()?,
                    four(&ends[1], constraint).ok()?,
                ];
                gradient[i] = if step > 0.0 {
                    (of(high) - of(low)) / (2.0 * step)
                } else {
                    0.0
                };
            }
            Some((gradient.transpose() * covariance * gradient)[0].sqrt())
        };
        let value = |value: f64, given: bool, of: &dyn Fn([f64; 4]) -> f64| Value {
            value,
            uncertainty: if given { None } else { uncertainty(of) },
        };
        let angle_given = matches!(constraint, Constraint::TanU(_));
        Ok(Self {
            constraint: match constraint {
                Constraint::Baseline(mm, Branch::Steep) => {
                    format!("b = {mm} mm, u above 45 degrees")
                }
                Constraint::Baseline(mm, Branch::Shallow) => {
                    format!("b = {mm} mm, u below 45 degrees")
                }
                Constraint::TanU(t) => format!("tan u = {t}"),
                Constraint::FocalLength(mm) => format!("f = {mm} mm"),
                Constraint::Offset(mm) => format!("d0 = {mm} mm"),
            },
            d0_mm: value(d0, matches!(constraint, Constraint::Offset(_)), &|four| {
                four[0]
            }),
            tan_u: value(t, angle_given, &|four| four[1]),
            u_degrees: value(t.atan().to_degrees(), angle_given, &|four| {
                four[1].atan().to_degrees()
            }),
            b_mm: value(b, matches!(constraint, Constraint::Baseline(..)), &|four| {
                four[2]
            }),
            f_mm: value(
                f,
                matches!(constraint, Constraint::FocalLength(_)),
                &|four| four[3],
            ),
            mirrored,
        })
    }
}

/// d0, t, b and f from D, K > 0 and xp, in millimetres.
fn four(found: &Vector3<f64>, constraint: Constraint) -> anyhow::Result<[f64; 4]> {
    let [d, k, pole] = [found[0], found[1], found[2]];
    // f > 0 and so t has the sign of -xp.
    let side = -pole.signum();
    let t = match constraint {
        Constraint::TanU(t) => t,
        Constraint::FocalLength(f) => -f / pole,
        Constraint::Offset(d0) => {
            // d0 - D = b/t = -K/(xp (1 + t^2)).
            let square = -k / (pole * (d0 - d)) - 1.0;
            ensure!(
                square > 0.0,
                "no sensor with d0 = {d0} mm has this curve: for one that has, d0 lies between {d:.1} and {:.1} mm",
                d - k / pole
            );
            side * square.sqrt()
        }
        Constraint::Baseline(b, branch) => {
            // t/(1 + t^2) is at most 1/2, at t = 1.
            let share = (b * pole / k).abs();
            ensure!(
                b > 0.0 && share <= 0.5,
                "no sensor with a baseline of {b} mm has this curve: with this D, K and xp it is at most {:.1} mm",
                0.5 * (k / pole).abs()
            );
            let root = (1.0 - 4.0 * share * share).sqrt();
            let shallow = 2.0 * share / (1.0 + root);
            side * match branch {
                Branch::Steep => 1.0 / shallow,
                Branch::Shallow => shallow,
            }
        }
    };
    let focal_length = -pole * t;
    ensure!(
        focal_length > 0.0,
        "no sensor with that has this curve: xp lies {:.2} mm from the middle of the row, and f = -xp tan u would be {focal_length:.2} mm",
        pole
    );
    let baseline = -k * t / (pole * (1.0 + t * t));
    Ok([d + baseline / t, t, baseline, focal_length])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::eq1::fit;
    use simulator::optics::Optics;

    fn points(mirrored: bool) -> Vec<(f64, f64)> {
        let optics = Optics {
            offset: 0.012,
            ..Optics::nominal()
        };
        let place = |x: f64| if mirrored { 3647.0 - x } else { x };
        (0..30)
            .map(|i| 0.60 + 0.014 * f64::from(i))
            .map(|distance| (place(optics.centre(distance)), distance))
            .collect()
    }

    /// Any one of the four gives the other three, whichever way the pixels are counted.
    #[test]
    fn one_that_is_given_gives_the_others() {
        for mirrored in [false, true] {
            let fit = fit(&points(mirrored)).expect("a fit");
            for constraint in [
                Constraint::Baseline(300.0, Branch::Steep),
                Constraint::TanU(2.6),
                Constraint::FocalLength(50.0),
                Constraint::Offset(12.0),
            ] {
                let found = Physical::of(&fit, constraint, Some(1e-12)).expect("parameters");
                assert_eq!(found.mirrored, mirrored);
                for (value, truth) in [
                    (found.d0_mm, 12.0),
                    (found.tan_u, 2.6),
                    (found.b_mm, 300.0),
                    (found.f_mm, 50.0),
                ] {
                    assert!(
                        (value.value / truth - 1.0).abs() < 1e-6,
                        "{constraint:?}: {value:?}"
                    );
                }
                let without = [found.d0_mm, found.tan_u, found.b_mm, found.f_mm];
                let given = without.iter().filter(|value| value.uncertainty.is_none());
                assert_eq!(given.count(), 1);
            }
        }
    }

    /// The other solution for the same baseline is another sensor with the same curve.
    #[test]
    fn a_baseline_has_two_solutions() {
        let fit = fit(&points(false)).expect("a fit");
        let shallow = Constraint::Baseline(300.0, Branch::Shallow);
        let found = Physical::of(&fit, shallow, None).expect("parameters");
        println!("{found:?}");
        assert!((found.tan_u.value * 2.6 - 1.0).abs() < 1e-6);
        let optics = Optics {
            offset: found.d0_mm.value * 1e-3,
            angle: found.tan_u.value.atan(),
            focal_length: found.f_mm.value * 1e-3,
            ..Optics::nominal()
        };
        for (centre, distance) in points(false) {
            assert!((optics.distance(centre) - distance).abs() < 1e-9);
        }
    }

    /// The uncertainty against the change that a parameter of the curve makes, one at a time.
    #[test]
    fn uncertainties_follow_the_covariance() {
        let fit = fit(&points(false)).expect("a fit");
        let variance = 1e-10;
        let found = Physical::of(&fit, Constraint::TanU(2.6), Some(variance)).expect("parameters");
        // With tan u given, f = -(xp - axis) tan u: nothing but xp is in it.
        let of_pole = (variance * fit.unit_covariance[(2, 2)]).sqrt();
        let expected = of_pole * PITCH_MM * 2.6;
        let uncertainty = found.f_mm.uncertainty.expect("an uncertainty");
        assert!((uncertainty / expected - 1.0).abs() < 1e-6);
    }
}
