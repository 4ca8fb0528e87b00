//! A smooth curve as knots with cubics between them, as the sensor holds it.

use slitrange::base::units::Pixels;
use slitrange::distance::knots::{Knot, Knots, KnotsError, MAX_KNOTS};

use crate::fixed::{micrometres, part_of_way, pixels};

/// What tabulation may add, in micrometres: a tenth of what noise leaves of the best calibrations.
const LIMIT: f64 = 0.1;
/// Places in each interval where the knots' curve is compared.
const PLACES: i32 = 16;
/// Places over the range between which a turn of the curve is looked for.
const STEPS: usize = 512;
/// Intervals of less than this are not divided, in pixels.
const NARROWEST: f64 = 0.25;

/// As few knots as keep within a tenth of a micrometre of a curve, which gives micrometres for a centre in
/// pixels; at most as many as there may be. The curve's turns are knots, where cubics that never go beyond
/// their knots would do badly; then intervals are divided where they are off.
///
/// # Errors
/// The values are too far apart for knots.
pub fn tabulate(
    curve: impl Fn(f64) -> f64,
    first: Pixels,
    last: Pixels,
) -> Result<Vec<Knot>, KnotsError> {
    let knot = |centre: Pixels| Knot {
        centre,
        value: micrometres(curve(centre.to_f64())),
    };
    let mut centres = turns(&curve, first, last);
    loop {
        let knots: Vec<Knot> = centres.iter().copied().map(knot).collect();
        let made = Knots::new(&knots)?;
        let intervals = centres.windows(2);
        let errors = intervals.map(|ends| error(&curve, &made, ends[0], ends[1]));
        let errors: Vec<f64> = errors.collect();
        let is_wide = |i: usize| centres[i + 1].to_f64() - centres[i].to_f64() > NARROWEST;
        let is_off = |i: &usize| errors[*i] > LIMIT && is_wide(*i);
        let mut divided: Vec<usize> = (0..errors.len()).filter(is_off).collect();
        divided.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]));
        divided.truncate(MAX_KNOTS.saturating_sub(centres.len()));
        if divided.is_empty() {
            return Ok(knots);
        }
        let middle = |i| part_of_way(centres[i], centres[i + 1], 1, 2);
        let middles: Vec<Pixels> = divided.into_iter().map(middle).collect();
        centres.extend(middles);
        centres.sort_unstable();
    }
}

/// Both ends, and between them the places where the curve turns.
fn turns(curve: &impl Fn(f64) -> f64, first: Pixels, last: Pixels) -> Vec<Pixels> {
    let (from, to) = (first.to_f64(), last.to_f64());
    let place = |i: usize| from + (to - from) * i as f64 / STEPS as f64;
    let mut turns = vec![first];
    for i in 1..STEPS {
        let [before, here, after] = [i - 1, i, i + 1].map(|i| curve(place(i)));
        if (here - before) * (after - here) < 0.0 {
            // The vertex of the parabola through the three.
            let bend = after - 2.0 * here + before;
            let turn =
                pixels(place(i) - 0.5 * (after - before) / bend * (to - from) / STEPS as f64);
            let apart = |other: Pixels| (turn.to_f64() - other.to_f64()).abs() > NARROWEST;
            if turns.iter().copied().all(apart) && apart(last) && turns.len() < MAX_KNOTS / 4 {
                turns.push(turn);
            }
        }
    }
    turns.push(last);
    turns.sort_unstable();
    turns
}

/// How far the knots' curve is off in an interval, at most, in micrometres.
fn error(curve: &impl Fn(f64) -> f64, knots: &Knots, from: Pixels, to: Pixels) -> f64 {
    let off = |part| {
        let centre = part_of_way(from, to, part, PLACES);
        let (value, _) = knots.at(centre).ok()?;
        Some((value.to_f64() - curve(centre.to_f64())).abs())
    };
    (0..=PLACES).filter_map(off).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many knots a curve gets, and how far their curve is off at most, in micrometres.
    fn tabulated(curve: impl Fn(f64) -> f64, first: Pixels, last: Pixels) -> (usize, f64) {
        let knots = tabulate(&curve, first, last).expect("knots");
        let made = Knots::new(&knots).expect("knots");
        let off = |ends: &[Knot]| error(&curve, &made, ends[0].centre, ends[1].centre);
        let most = knots.windows(2).map(off).fold(0.0, f64::max);
        println!("{} knots, {most:.3} um", knots.len());
        (knots.len(), most)
    }

    /// A cubic of 300 um, as a lens gives it, and a wave with five turns.
    #[test]
    fn smooth_curves_need_few_knots() {
        let (first, last) = (Pixels::from_int(1290), Pixels::from_int(2404));
        let part = |x: f64| (x - 1847.0) / 557.0;
        let cubic = |x: f64| 300.0 * (4.0 * part(x).powi(3) - 3.0 * part(x));
        let wave = |x: f64| 300.0 * (8.0 * part(x)).sin();
        let (knots, most) = tabulated(cubic, first, last);
        assert!(knots <= 65 && most < LIMIT + 0.01);
        let (knots, most) = tabulated(wave, first, last);
        assert!(knots <= MAX_KNOTS && most < 0.2);
    }

    #[test]
    fn a_jump_leaves_an_error_above_the_limit() {
        let (first, last) = (Pixels::from_int(1000), Pixels::from_int(3000));
        let jump = |x| if x < 2000.5 { 0.0 } else { 1000.0 };
        let (knots, most) = tabulated(jump, first, last);
        assert!(knots <= MAX_KNOTS && most > LIMIT);
    }
}
