//! Spots that are elsewhere in some rows, and rows that keep what was before.

use crate::hard_cases::Truth;
use crate::second_judge::plan::Plan;
use crate::second_judge::spot::Spot;
use crate::second_judge::{Rng, log_even, side};
use rand::Rng as _;
use std::f64::consts::TAU;

/// A laser that changes its mode: from one row on the spot is elsewhere. The truth is from the one place to
/// the other. A single row has one of these places.
pub fn mode_hop(plan: &mut Plan, random: &mut Rng) {
    let step = side(random) * log_even(random, 0.05, 1.0) * plan.spot.width;
    let from = random.random_range(1..plan.rows.max(2));
    plan.speed = 0.0;
    plan.shifts = (0..plan.rows)
        .map(|row| if row < from { 0.0 } else { step })
        .collect();
    plan.truth = plan.truth.reaching(plan.spot.centre + step);
}

/// A target that swings. The truth is from the spot's place in the middle of the frame to its mean place.
pub fn vibration(plan: &mut Plan, random: &mut Rng) {
    let amplitude = log_even(random, 0.3, 2.0);
    let periods = log_even(random, 0.3, 3.0);
    let phase = TAU * random.random::<f64>();
    let rows = plan.rows as f64;
    let shift = |row: f64| amplitude * (TAU * periods * row / rows + phase).sin();
    plan.speed = 0.0;
    plan.shifts = (0..plan.rows).map(|row| shift(row as f64)).collect();
    let mean = plan.shifts.iter().sum::<f64>() / rows;
    let centre = plan.spot.centre;
    plan.truth = Truth::Centre(centre + shift(0.5 * (rows - 1.0))).reaching(centre + mean);
}

/// Every other pixel shows the row before, as two buffers that are swapped too late make it. The spot moves
/// steadily, also before the frame. The truth is from the place of the row to that of the row before.
pub fn old_pixels(plan: &mut Plan, random: &mut Rng) {
    // A frame in which the spot moves by more than 1.5 of its widths has no centre.
    let most = if plan.rows == 1 { 1.0 } else { 0.1 };
    let step = side(random) * most * log_even(random, 0.1, 1.0) * plan.spot.width;
    let first = random.random_range(0..2);
    plan.speed = step;
    plan.truth = plan.truth.reaching(plan.spot.centre - step);
    plan.light.add(move |pixels, moment, _| {
        let before = Spot {
            centre: moment.spot.centre - step,
            ..moment.spot
        };
        let mut old = vec![0.0; pixels.len()];
        before.add_to(&mut old, |_| 1.0);
        for (pixel, old) in pixels.iter_mut().zip(old).skip(first).step_by(2) {
            *pixel = old;
        }
    });
}
