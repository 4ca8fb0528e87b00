//! Calibrations that are hard: eq. (1) at its pole and beyond what integers hold, tables that are none.

use slitrange::distance::eq1::{Eq1, NOMINAL};
use slitrange::distance::knots::{CLOSEST, Knot, MAX_KNOTS};
use slitrange::distance::residuals::Corrected;
use slitrange::distance::table::Table;
use slitrange::{Calibration, Fault, Micrometres, Pixels};
use std::fmt;

/// A calibration that is hard in one way. No estimator has to do with it.
#[derive(Clone, Debug)]
pub struct CalibrationCase {
    /// What it is, in a few words.
    pub name: &'static str,
    /// Why it is hard.
    pub why: &'static str,
    /// What must come out.
    pub due: CalibrationDue,
    made: Made,
}

/// What must come of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CalibrationDue {
    /// It is refused, with the error of this name.
    Refused(&'static str),
    /// It is taken, and its distance is eq. (1)'s, or the knots', within so many micrometres.
    Exact(f64),
}

#[derive(Clone, Debug)]
struct Made {
    /// A calibration, or why there is none.
    calibration: Result<Calibration, Refusal>,
    /// D (um), K (um px) and xp (px) of eq. (1).
    parameters: [f64; 3],
    /// The knots of a table or of residuals.
    knots: Vec<Knot>,
}

#[derive(Clone, Debug)]
struct Refusal {
    /// The error's name, as the code has it.
    name: String,
    words: String,
}

impl Made {
    fn of<E: fmt::Debug + fmt::Display>(
        made: Result<Calibration, E>,
        parameters: [f64; 3],
        knots: Vec<Knot>,
    ) -> Self {
        Self {
            calibration: made.map_err(|error| Refusal {
                name: format!("{error:?}"),
                words: error.to_string(),
            }),
            parameters,
            knots,
        }
    }
}

/// What came of a case.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    /// In words.
    pub answer: String,
    /// Whether it is what is due.
    pub is_due: bool,
}

impl CalibrationCase {
    /// Makes it, and asks for distances over its range and outside.
    pub fn run(&self) -> Found {
        match &self.made.calibration {
            Ok(calibration) => self.taken(calibration),
            Err(why) => Found {
                answer: format!("refused: {}", why.words),
                is_due: matches!(self.due, CalibrationDue::Refused(name) if why.name.contains(name)),
            },
        }
    }

    /// What the distance at a centre should be in micrometres, where that is known.
    fn expected(&self, calibration: &Calibration, x: f64) -> Option<f64> {
        let knot = self.made.knots.iter();
        let at_knot = || knot.clone().find(|knot| knot.centre.to_f64() == x);
        let [d, k, pole] = self.made.parameters;
        match calibration {
            Calibration::Eq1(_) => Some(d + k / (x - pole)),
            Calibration::Table(_) => Some(at_knot()?.value.to_f64()),
            Calibration::Corrected(corrected) => {
                let centre = Pixels::from_bits((x * 65536.0) as i32);
                let base = corrected.curve().distance_at(centre);
                Some(base.ok()?.0.to_f64() + at_knot()?.value.to_f64())
            }
        }
    }

    /// Distances at 2001 centres over the range and at the knots, against what they should be where that is
    /// known; beyond the range a fault. The distance goes one way, but for steps of Q24.8 back.
    fn taken(&self, calibration: &Calibration) -> Found {
        let (from, to) = calibration.valid();
        let step_back = match calibration {
            Calibration::Corrected(_) => STEP_BACK,
            _ => 0,
        };
        let span = i64::from(to.to_bits()) - i64::from(from.to_bits());
        let even = (0..=2000).map(|step| (i64::from(from.to_bits()) + span * step / 2000) as i32);
        let mut centres: Vec<i32> = even.collect();
        centres.extend(self.made.knots.iter().map(|knot| knot.centre.to_bits()));
        centres.sort_unstable();
        let (mut worst, mut nonsense) = (0.0f64, None);
        let mut before: Option<Micrometres> = None;
        for centre in centres.into_iter().map(Pixels::from_bits) {
            let (distance, slope) = match calibration.distance_at(centre) {
                Ok(found) => found,
                Err(fault) => {
                    nonsense = Some(format!("{} at {centre} px", fault.name()));
                    continue;
                }
            };
            if !slope.is_finite() || slope == 0.0 {
                nonsense = Some(format!("slope {slope} at {centre} px"));
            }
            if let Some(before) = before.replace(distance) {
                let onward = i64::from(distance.to_bits()) - i64::from(before.to_bits());
                let onward = if slope > 0.0 { onward } else { -onward };
                if onward < -i64::from(step_back) {
                    nonsense = Some(format!("turns back at {centre} px"));
                }
            }
            if let Some(expected) = self.expected(calibration, centre.to_f64()) {
                worst = worst.max((distance.to_f64() - expected).abs());
            }
        }
        for outside in [from.to_bits().checked_sub(1), to.to_bits().checked_add(1)] {
            let Some(centre) = outside.map(Pixels::from_bits) else {
                continue;
            };
            if calibration.distance_at(centre) != Err(Fault::OutOfRange { centre }) {
                nonsense = Some(format!("a distance at {centre} px, outside"));
            }
        }
        let is_exact = matches!(self.due, CalibrationDue::Exact(within) if worst <= within);
        Found {
            is_due: is_exact && nonsense.is_none(),
            answer: nonsense.unwrap_or_else(|| format!("within {worst:.4} um")),
        }
    }
}

/// Steps of Q24.8 that eq. (1) with residuals may go back: both parts are rounded (see [`Corrected`]).
const STEP_BACK: i32 = 4;

/// Eq. (1) from D (um), K (um px), xp (px) and the ends of its range (px).
fn curve(d: f64, k: f64, pole: f64, from: f64, to: f64) -> Made {
    let pixels = |value: f64| Pixels::from_bits((value * 65536.0).round() as i32);
    let d = Micrometres::from_bits((d * 256.0).round() as i32);
    let k_bits = (k * 65536.0) as i64;
    let made = Eq1::new(d, k_bits, pixels(pole), pixels(from)..=pixels(to));
    let parameters = [d.to_f64(), k_bits as f64 / 65536.0, pixels(pole).to_f64()];
    Made::of(made.map(Calibration::Eq1), parameters, vec![])
}

fn knots(places: &[(f64, f64)]) -> Vec<Knot> {
    let knot = |&(centre, value): &(f64, f64)| Knot {
        centre: Pixels::from_bits((centre * 65536.0).round() as i32),
        value: Micrometres::from_bits((value * 256.0).round() as i32),
    };
    places.iter().map(knot).collect()
}

fn table(places: &[(f64, f64)]) -> Made {
    let knots = knots(places);
    let made = Table::new(&knots).map(Calibration::Table);
    Made::of(made, [f64::NAN; 3], knots)
}

fn corrected(places: &[(f64, f64)]) -> Made {
    let knots = knots(places);
    let made = Corrected::new(NOMINAL.expect("a curve"), &knots);
    Made::of(made.map(Calibration::Corrected), [f64::NAN; 3], knots)
}

/// So many knots 8 pixels apart, 400 um from one to the next.
fn many(knots: usize) -> Vec<(f64, f64)> {
    let knot = |i: usize| (8.0 * i as f64, 1e6 - 400.0 * i as f64);
    (0..knots).map(knot).collect()
}

/// Rounding to Q24.8 is off by half of a 256th, and f64's own rounding by less.
const ROUNDED: CalibrationDue = CalibrationDue::Exact(0.01);
/// A table is exact at its knots.
const AT_KNOTS: CalibrationDue = CalibrationDue::Exact(0.0);
/// Eq. (1) and the residual are rounded each for itself: two halves of a 256th.
const AT_RESIDUALS: CalibrationDue = CalibrationDue::Exact(0.01);

/// The cases.
#[rustfmt::skip] // A case a line.
pub fn calibrations() -> Vec<CalibrationCase> {
    use CalibrationDue::Refused;
    let nominal = NOMINAL.expect("a curve");
    let parameters = [nominal.d().to_f64(), nominal.k() as f64 / 65536.0, nominal.pole().to_f64()];
    let close = CLOSEST.to_f64();
    let case = |name, why, due, made| CalibrationCase { name, why, due, made };
    vec![
        case("eq. (1): nominal", "a sensor without its own calibration uses it", ROUNDED,
            Made { calibration: Ok(Calibration::Eq1(nominal)), parameters, knots: vec![] }),
        case("eq. (1): xp in the range", "a division by zero", Refused("Pole"),
            curve(0.0, 6e8, 500.0, 0.0, 1000.0)),
        case("eq. (1): xp at the first centre", "a division by zero at the end", Refused("Pole"),
            curve(0.0, 6e8, 0.0, 0.0, 1000.0)),
        case("eq. (1): xp half a pixel beyond the last", "distances run away", Refused("Pole"),
            curve(0.0, 6e8, 1000.5, 0.0, 1000.0)),
        case("eq. (1): xp a pixel before the first", "the steepest curve that is allowed", ROUNDED,
            curve(0.0, 8e6, -1.0, 0.0, 1000.0)),
        case("eq. (1): xp on the sensor, outside the range", "half of the sensor is beyond the pole", ROUNDED,
            curve(0.0, -3e7, 1500.0, 0.0, 1400.0)),
        case("eq. (1): K = 0", "every centre means the same distance", Refused("K"),
            curve(5e5, 0.0, -1000.0, 0.0, 1000.0)),
        case("eq. (1): the least K", "every centre means nearly the same distance", Refused("Flat"),
            curve(5e5, 1.0 / 65536.0, -1000.0, 0.0, 1000.0)),
        case("eq. (1): K below zero", "distance rises with the centre", ROUNDED,
            curve(1e6, -6e8, -1000.0, 0.0, 1000.0)),
        case("eq. (1): the largest K", "its numerator fills 63 bits", ROUNDED,
            curve(-8e6, 5.497e11, -32_768.0, 30_000.0, 32_000.0)),
        case("eq. (1): K beyond that", "its numerator would overflow", Refused("K"),
            curve(0.0, 5.5e11, -32_768.0, 30_000.0, 32_000.0)),
        case("eq. (1): 10 m at one end", "more than 32 bits hold", Refused("Distance"),
            curve(0.0, 1e10, -1000.0, 0.0, 1000.0)),
        case("eq. (1): D at the lowest", "the lowest value that 32 bits hold", ROUNDED,
            curve(-8_388_608.0, 6e9, -1000.0, 0.0, 1000.0)),
        case("eq. (1): one centre", "an empty range", Refused("Empty"), curve(0.0, 6e8, -1000.0, 5.0, 5.0)),
        case("eq. (1): range the wrong way round", "an empty range", Refused("Empty"),
            curve(0.0, 6e8, -1000.0, 1000.0, 0.0)),
        // The curve is steep enough at the far end: K / 65530^2 = 1/8 um a pixel.
        case("eq. (1): over all centres that there are", "differences of 33 bits", ROUNDED,
            curve(0.0, 5.37e8, -32_768.0, -32_700.0, 32_767.0)),
        case("table: two knots", "the fewest that make a table", AT_KNOTS,
            table(&[(100.0, 9e5), (900.0, 6e5)])),
        case("table: one knot", "no line goes through one point", Refused("TooFew"), table(&[(100.0, 9e5)])),
        case("table: no knots", "nothing", Refused("TooFew"), table(&[])),
        case("table: equal knots", "a division by zero between them", Refused("Order"),
            table(&[(100.0, 9e5), (500.0, 8e5), (500.0, 7e5), (900.0, 6e5)])),
        case("table: knots not sorted", "the binary search would fail", Refused("Order"),
            table(&[(100.0, 9e5), (700.0, 7e5), (500.0, 8e5), (900.0, 6e5)])),
        case("table: distances not monotone", "two centres for one distance", Refused("NotMonotone"),
            table(&[(100.0, 9e5), (500.0, 7e5), (700.0, 7.5e5), (900.0, 6e5)])),
        case("table: equal distances", "with a slope of zero the claimed uncertainty would be zero",
            Refused("NotMonotone"),
            table(&[(100.0, 9e5), (500.0, 7e5), (700.0, 7e5), (900.0, 6e5)])),
        case("table: knots as close as they may be", "the steepest line", AT_KNOTS,
            table(&[(100.0, 9e5), (100.0 + close, 8e5), (900.0, 6e5)])),
        case("table: knots closer than that", "the slope would be steeper than that of any sensor",
            Refused("Order"),
            table(&[(100.0, 9e5), (100.0 + 0.5 * close, 8e5), (900.0, 6e5)])),
        case("table: spacing from 1/16 to 30,000 pixels",
            "the widths of the pieces differ by a factor of half a million",
            AT_KNOTS, table(&[(-100.0, 3e6), (0.0, 2e6), (close, 1.9e6), (30_000.0, 1e6)])),
        case("table: one too many", "more than the memory has room for",
            Refused("TooMany"), table(&many(MAX_KNOTS + 1))),
        case("table: the most knots", "the memory is full", AT_KNOTS, table(&many(MAX_KNOTS))),
        case("table: 16 m from one knot to the next", "a difference of 33 bits", Refused("Step"),
            table(&[(0.0, 8.3e6), (900.0, -8.3e6)])),
        case("table: a cliff between slopes", "a cubic that overshoots would turn back", AT_KNOTS,
            table(&[(0.0, 1e6), (100.0, 9.999e5), (101.0, 1e5), (900.0, 9.99e4)])),
        case("residuals: of 100 um", "the mounting departs from eq. (1)", AT_RESIDUALS,
            corrected(&[(1200.0, 100.0), (1800.0, -100.0), (2600.0, 50.0)])),
        case("residuals: steeper than the curve", "the sum would turn back", Refused("Steep"),
            corrected(&[(1200.0, 0.0), (1300.0, 200_000.0), (2600.0, 0.0)])),
        case("residuals: beyond the curve's range", "there is no curve to correct", Refused("Beyond"),
            corrected(&[(1000.0, 0.0), (2600.0, 10.0)])),
    ]
}
