//! Whether a calibration is good enough, in one line.

use std::fmt;

use serde::Serialize;
use slitrange::distance::Calibration;
use slitrange::distance::eq1::NOMINAL;
use slitrange::reading::uncertainty::{CalibrationErrors, FittedErrors};
use slitrange_device::record::Record;

use super::form::Made;
use crate::fit::observed::Weights;
use crate::fit::order::FEWEST_TO_REJECT;
use crate::fit::solve::Solved;

/// The largest uncertainty of a good curve, over its range of distances. Makers of triangulation sensors
/// state a linearity of 0.05 to 0.3 % of the range.
const GOOD: f64 = 1e-3;
/// The largest uncertainty of a usable curve, over its range of distances.
const USABLE: f64 = 1e-2;
/// Points that scatter by more than this factor over what was given of their errors have another error, too.
pub const SCATTERED: f64 = 1.5;
/// More rejected points than this share are no matter of a few slips.
const REJECTED: f64 = 0.1;

/// A verdict.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// The verdict in a word or two.
    pub calibration: Grade,
    /// The curve's largest standard uncertainty over its range. None if the points do not tell it.
    pub largest_uncertainty_um: Option<f64>,
    /// That, and what speaks against the calibration.
    pub because: String,
}

/// How good a calibration is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Grade {
    /// Nothing speaks against it.
    Good,
    /// A person can use it, with the uncertainty that the verdict states.
    Usable,
    /// The sensor would be wrong by more than a hundredth of its range, or nobody can tell.
    NotUsable,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = match self.calibration {
            Grade::Good => "good",
            Grade::Usable => "usable",
            Grade::NotUsable => "not usable",
        };
        write!(f, "Calibration {words}: {}", self.because)
    }
}

impl Verdict {
    /// The verdict on a calibration.
    pub fn of(solved: &Solved, made: &Made<'_>) -> Self {
        let (first, last) = made.curve.eq1.valid;
        let ends = [first, last].map(|centre| (centre, 1e3 * made.curve.distance(centre)));
        let largest_uncertainty = solved.quality(made.form).largest_uncertainty;
        let largest_uncertainty_um = largest_uncertainty.map(|metres| 1e6 * metres);
        let (calibration, doubt) = match not_usable(ends, largest_uncertainty_um) {
            Some(reason) => (Grade::NotUsable, Some(reason)),
            None => match doubt(solved, made, ends, largest_uncertainty_um.unwrap_or(0.0)) {
                Some(doubt) => (Grade::Usable, Some(doubt)),
                None => (Grade::Good, None),
            },
        };
        let [(_, first_mm), (_, last_mm)] = ends;
        let (least, most) = (first_mm.min(last_mm), first_mm.max(last_mm));
        let figure = largest_uncertainty_um.map(|um| {
            format!("the curve is uncertain by {um:.1} um at most, from {least:.0} to {most:.0} mm")
        });
        let because: Vec<String> = figure.into_iter().chain(doubt).collect();
        Self {
            calibration,
            largest_uncertainty_um,
            because: because.join("; "),
        }
    }
}

/// Why a record's calibration is not usable. None if it is, and for the nominal one, which counts its
/// tolerances.
pub fn against(record: &Record) -> Option<String> {
    let calibration = &record.calibration;
    let is_nominal = NOMINAL.is_ok_and(|it| *calibration == Calibration::Eq1(it));
    let largest_uncertainty_um = match &record.errors {
        CalibrationErrors::Nominal if is_nominal => return None,
        CalibrationErrors::Fitted(FittedErrors { curve, .. }) => {
            curve.iter().max().map(|most| most.to_f64())
        }
        CalibrationErrors::Nominal | CalibrationErrors::Unknown => None,
    };
    let (first, last) = calibration.valid();
    let ends = [first, last].map(|centre| {
        let distance = calibration.distance_at(centre).map(|it| it.0.to_f64());
        (centre.to_f64(), 1e-3 * distance.unwrap_or(f64::NAN))
    });
    not_usable(ends, largest_uncertainty_um)
}

/// Centre in pixels and distance in millimetres of a calibration's first and last place.
type Ends = [(f64, f64); 2];

/// Why a calibration is not usable whatever else is good, and what to do.
fn not_usable(ends: Ends, largest_uncertainty_um: Option<f64>) -> Option<String> {
    let Some(um) = largest_uncertainty_um else {
        let unknown = "nothing tells how uncertain the curve is; take more points than three";
        return Some(unknown.into());
    };
    // Not a number is not usable.
    let is_usable = um / (1e3 * span_mm(ends)) <= USABLE;
    (!is_usable).then(|| more_than(USABLE)).or_else(|| {
        off_scale(ends)
            .filter(|(is_slip, _)| *is_slip)
            .map(|it| it.1)
    })
}

fn more_than(part: f64) -> String {
    format!(
        "that is more than {} % of the range: take more points, or measure their distances better",
        100.0 * part
    )
}

fn span_mm([(_, first), (_, last)]: Ends) -> f64 {
    (last - first).abs()
}

/// How far xp of a head that is built as docs/hardware/optics.md says may be from the drawing's, in pixels,
/// and by what factor K: the angle is 1.5 degrees off (188 px, 2 %), the beam's included, the slit 0.5 mm (63
/// px), and its distance from the pixels 0.5 mm (24 px, 1 %).
const XP_OFF: f64 = 275.0;
const K_OFF: f64 = 1.033;

/// That distances do not change with the centre as before such a head, and whether it is a slip of the unit
/// or of the columns. The zero of the distances may be anywhere.
fn off_scale(ends: Ends) -> Option<(bool, String)> {
    // K in mm px and xp in px of the nominal geometry, D + K/(x - xp).
    const K: f64 = 2_152_367.0;
    const XP: f64 = -580.35;
    let due = |from: f64, to: f64, off: f64| {
        (K / (from - XP - off) - K / (to - XP - off)).abs() * K_OFF.powf(off / XP_OFF)
    };
    let is_due =
        |span: f64, from, to| (due(from, to, -XP_OFF)..=due(from, to, XP_OFF)).contains(&span);
    let [(first, first_mm), (last, last_mm)] = ends;
    let span = span_mm(ends);
    if is_due(span, first, last) {
        return None;
    }
    let is_on_row = |it| (0.0..4096.0).contains(&it);
    let are_on_row = is_on_row(first_mm) && is_on_row(last_mm);
    let slip = if is_due(10.0 * span, first, last) {
        Some("d_mm seems to be in centimetres")
    } else if is_due(25.4 * span, first, last) {
        Some("d_mm seems to be in inches")
    } else if are_on_row && is_due(last - first, first_mm, last_mm) {
        Some("the columns x_px and d_mm seem to be exchanged")
    } else {
        None
    };
    let cause = slip.unwrap_or("check units and columns, unless this head has other dimensions");
    let nominal = due(first, last, 0.0);
    let text = format!(
        "the distances cover {span:.1} mm, and a head as drawn sees {nominal:.1} mm between these centres: \
         {cause}"
    );
    Some((slip.is_some(), text))
}

/// What speaks against a calibration that is usable, the worst first, and what to do.
fn doubt(solved: &Solved, made: &Made<'_>, ends: Ends, um: f64) -> Option<String> {
    let points = solved.points.len();
    let rejected = solved.verdicts.iter().filter(|it| !it.kept).count();
    if let Some((_, text)) = off_scale(ends) {
        return Some(text);
    }
    if points < FEWEST_TO_REJECT {
        let doubt = format!("with fewer than {FEWEST_TO_REJECT} points, none could be rejected");
        return Some(doubt);
    }
    if rejected as f64 > REJECTED * points as f64 {
        let doubt = format!("{rejected} of {points} points are rejected: take them again");
        return Some(doubt);
    }
    if let Some(scatter) = solved.quality(made.form).scatter
        && scatter > SCATTERED
        && solved.weights == Weights::Known
    {
        return Some(format!(
            "points scatter {scatter:.1} times as much as was given: speckle, or --position-uncertainty is \
             too small"
        ));
    }
    let repeats = solved.repeats.as_ref();
    if let Some((mm, _)) = repeats.and_then(|it| it.backlash_mm)
        && 0.5 * mm.abs() > GOOD * span_mm(ends)
    {
        return Some(format!(
            "on the way up and on the way down, distances differ by {mm:.3} mm: come to each from the same \
             side"
        ));
    }
    (um / (1e3 * span_mm(ends)) > GOOD).then(|| more_than(GOOD))
}

#[cfg(test)]
mod tests {
    use super::*;
    use simulator::optics::Optics;

    #[test]
    fn slips_are_told_from_heads_within_their_tolerances() {
        let ends = |optics: Optics, near: f64, far: f64, unit: f64| {
            [far, near].map(|it: f64| (optics.centre(it), unit * it))
        };
        let mut head = Optics::nominal();
        for (degrees, slit_px) in [(0.0, 0.0), (1.5, 63.0), (-1.5, -63.0)] {
            head.angle = Optics::nominal().angle + f64::to_radians(degrees);
            head.axis = Optics::nominal().axis + slit_px;
            for (near, far) in [(0.6, 1.02), (0.8, 0.81), (0.45, 2.0)] {
                // Also a stage whose zero is far, and that counts towards the sensor.
                for unit in [1e3, -1e3] {
                    assert_eq!(
                        off_scale(ends(head, near, far, unit)),
                        None,
                        "{degrees} {near}"
                    );
                }
                let [(first, far_mm), (last, near_mm)] = ends(head, near, far, 1e3);
                for (ends, cause) in [
                    (ends(head, near, far, 1e2), Some("centimetres")),
                    (ends(head, near, far, 1e3 / 25.4), Some("inches")),
                    ([(near_mm, last), (far_mm, first)], Some("exchanged")),
                    (ends(head, near, far, 4e3), None),
                ] {
                    let (is_slip, text) = off_scale(ends).expect("off");
                    assert_eq!(is_slip, cause.is_some(), "{text}");
                    assert!(
                        text.contains(cause.unwrap_or("unless this head has other")),
                        "{text}"
                    );
                }
            }
        }
    }
}
