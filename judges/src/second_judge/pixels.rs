//! Faults of the pixels.

use crate::second_judge::plan::{Plan, add};
use crate::second_judge::sensor::FULL_SCALE;
use crate::second_judge::spot::Spot;
use crate::second_judge::{Rng, log_even, side};
use rand::Rng as _;
use rand_distr::{Distribution as _, StandardNormal};

/// Wells that fill below full scale and leak to one side: no count is at full scale.
pub fn blooming_tail(plan: &mut Plan, random: &mut Rng) {
    let well = (FULL_SCALE - plan.sensor.black) * random.random_range(0.3..0.9);
    plan.spot.height = well / (1.0 - random.random_range(0.05..0.6));
    let leak = log_even(random, 0.02, 0.3);
    let lost = 1.0 - (-1.0 / log_even(random, 1.0, 15.0)).exp();
    let is_right = random.random_bool(0.5);
    plan.charge.add(move |pixels, _, _| {
        let mut carried = 0.0;
        let mut fill = |pixel: &mut f64| {
            let excess = (*pixel - well).max(0.0);
            let arrives = lost * carried;
            carried += leak * excess - arrives;
            *pixel = (*pixel + arrives).min(well);
        };
        match is_right {
            true => pixels.iter_mut().for_each(&mut fill),
            false => pixels.iter_mut().rev().for_each(&mut fill),
        }
    });
}

/// Charge of earlier rows stays. The spot was elsewhere before, by so much from row to row.
///
/// A single row cannot show what the spot left behind less than a width away: that light only shifts the
/// spot. In a frame the spot moves by a tenth of its width from row to row at most, and is shifted by less.
pub fn lag(plan: &mut Plan, random: &mut Rng) {
    // What an image leaves behind in each following row.
    const ROWS: i32 = 3;
    let share = log_even(random, 0.01, 0.08);
    let step = side(random) * log_even(random, 0.1, 2.0) * plan.spot.width;
    plan.leave_room(share * plan.spot.height);
    // A frame in which the spot moves by more than 1.5 of its widths has no centre.
    plan.speed = step.clamp(-0.1 * plan.spot.width, 0.1 * plan.spot.width);
    let speed = plan.speed;
    plan.light.add(move |pixels, moment, _| {
        // Before the frame it moved faster, and came to this place in the row before the first.
        let step = if moment.row == 0 { step } else { speed };
        for age in 1..=ROWS {
            let spot = Spot {
                height: share.powi(age) * moment.spot.height,
                centre: moment.spot.centre - step * f64::from(age),
                ..moment.spot
            };
            if spot.height > 0.05 {
                spot.add_to(pixels, |_| 1.0);
            }
        }
    });
}

/// Pixels side by side near the spot: the first, and how many.
fn block(plan: &Plan, random: &mut Rng, most: usize) -> std::ops::Range<usize> {
    let first = plan.spot.centre + random.random_range(-3.0..3.0) * plan.spot.width;
    let first = first.clamp(0.0, plan.sensor.pixels as f64 - 8.0) as usize;
    first..first + random.random_range(1..=most)
}

/// Pixels that leak.
pub fn hot_block(plan: &mut Plan, random: &mut Rng) {
    let block = block(plan, random, 4);
    let counts = log_even(random, 30.0, 3000.0);
    plan.light
        .add(move |pixels, _, _| add(&mut pixels[block.clone()], |_| counts));
}

/// Pixels that see no light.
pub fn dead_block(plan: &mut Plan, random: &mut Rng) {
    let block = block(plan, random, 6);
    plan.charge
        .add(move |pixels, _, _| pixels[block.clone()].fill(0.0));
}

/// A pixel that always reads the same.
pub fn stuck(plan: &mut Plan, random: &mut Rng) {
    let block = block(plan, random, 1);
    let value = random.random_range(0.0..FULL_SCALE);
    plan.volts
        .add(move |pixels, _, _| pixels[block.clone()].fill(value));
}

/// Dark currents that differ.
pub fn uneven_dark(plan: &mut Plan, random: &mut Rng) {
    let deviation = log_even(random, 1.0, 8.0);
    let offsets = normals(plan, random);
    plan.charge
        .add(move |pixels, _, _| add(pixels, |i| deviation * offsets[i as usize]));
}

/// Pixels of unlike sizes.
pub fn uneven_response(plan: &mut Plan, random: &mut Rng) {
    let deviation = log_even(random, 0.003, 0.04);
    let responses = normals(plan, random);
    plan.leave_room(2.0 * deviation * plan.spot.height);
    plan.light.add(move |pixels, _, _| {
        for (pixel, response) in pixels.iter_mut().zip(&responses) {
            *pixel *= 1.0 + deviation * response;
        }
    });
}

/// Pixels that differ in both ways, on a sensor without a map of its pixels.
pub fn uneven_both(plan: &mut Plan, random: &mut Rng) {
    let response = log_even(random, 0.005, 0.02);
    let offset = if random.random_bool(0.5) { 2.0 } else { 5.0 };
    let [responses, offsets] = [normals(plan, random), normals(plan, random)];
    plan.leave_room(2.0 * response * plan.spot.height);
    plan.charge.add(move |pixels, _, _| {
        for (i, pixel) in pixels.iter_mut().enumerate() {
            *pixel = *pixel * (1.0 + response * responses[i]) + offset * offsets[i];
        }
    });
}

fn normals(plan: &Plan, random: &mut Rng) -> Vec<f64> {
    (0..plan.sensor.pixels)
        .map(|_| StandardNormal.sample(random))
        .collect()
}

/// Two outputs, for odd and for even pixels, whose amplifiers differ.
pub fn odd_even(plan: &mut Plan, random: &mut Rng) {
    let gain = side(random) * random.random_range(0.0..0.06);
    let offset = side(random) * random.random_range(0.0..20.0);
    plan.leave_room(0.06 * plan.spot.height + 20.0);
    plan.charge.add(move |pixels, _, _| {
        for pixel in pixels.iter_mut().skip(1).step_by(2) {
            *pixel = *pixel * (1.0 + gain) + offset;
        }
    });
}
