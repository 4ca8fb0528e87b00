//! Faults at the target, and light that is not the laser's: more than one spot, none, too much of one.

use crate::hard_cases::Truth;
use crate::second_judge::plan::Plan;
use crate::second_judge::sensor::FULL_SCALE;
use crate::second_judge::spot::{Shape, Spot};
use crate::second_judge::{Rng, gaussian, log_even, side};
use rand::Rng as _;

/// Nothing is wrong.
pub fn clean(_: &mut Plan, _: &mut Rng) {}

/// The narrowest spots that are measured, with side lobes. The truth is the centre.
pub fn narrow_sinc2(plan: &mut Plan, random: &mut Rng) {
    plan.spot.shape = Shape::sinc2();
    // The gaussian that fits sinc^2(u) best, by least squares, has a sigma of 0.3600. The gaussian of the
    // same half-height width has 0.3762.
    plan.spot.width = random.random_range(1.2..1.5) * 0.3762 / 0.3600;
    plan.calibrate(random);
}

/// A steady motion. The truth is the spot's place in the middle of the frame.
pub fn moves(plan: &mut Plan, random: &mut Rng) {
    plan.speed = side(random) * log_even(random, 0.02, 0.6);
}

/// A wide light as a lamp or the sky makes it. The spot is at most six times as high.
pub fn hump(plan: &mut Plan, random: &mut Rng) {
    add_hump(plan, random);
    plan.spot.height = log_even(random, 60.0, 400.0);
    // With more noise, a spot of 60 counts and 1.2 px would be too dim for a centre.
    plan.sensor.read_noise = plan.sensor.read_noise.min(2.5);
    plan.sensor.electrons = plan.sensor.electrons.max(8.0);
}

/// The wide light without a spot: nothing that a laser makes is that wide.
pub fn hump_alone(plan: &mut Plan, random: &mut Rng) {
    add_hump(plan, random);
    plan.remove_spot();
}

fn add_hump(plan: &mut Plan, random: &mut Rng) {
    // Long enough to show that the light is wide.
    plan.sensor.pixels = 2048;
    plan.place(random.random_range(200.0..1848.0));
    let height = log_even(random, 20.0, 100.0);
    let width = random.random_range(200.0..400.0);
    let centre = random.random_range(0.0..2048.0);
    plan.add_light(move |i| height * gaussian(i, centre, width));
}

/// Noise, and even light.
pub fn dark(plan: &mut Plan, random: &mut Rng) {
    plan.remove_spot();
    let ambient = random.random_range(0.0..100.0);
    plan.add_light(move |_| ambient);
}

/// A spot whose top is cut off at full scale.
pub fn saturated(plan: &mut Plan, random: &mut Rng) {
    plan.spot.height = (FULL_SCALE - plan.sensor.black) * log_even(random, 1.05, 4.0);
}

/// A spot at an end of the row. The truth is the centre of the whole spot, also beyond the end.
pub fn edge(plan: &mut Plan, random: &mut Rng) {
    let inside = random.random_range(-1.0..5.0) * plan.spot.width;
    let last = plan.sensor.pixels as f64 - 1.0;
    let is_first = random.random_bool(0.5);
    plan.place(if is_first { inside } else { last - inside });
}

/// Two spots of similar height: nobody can tell which one is the laser's.
pub fn two_like(plan: &mut Plan, random: &mut Rng) {
    // At least 4 sigma, so that two peaks show.
    let offset =
        side(random) * random.random_range(4.0..(150.0 / plan.spot.width).clamp(5.0, 30.0));
    let share = random.random_range(0.85..1.15);
    plan.leave_room(0.15 * plan.spot.height);
    add_spot(plan, share, offset, 1.0);
    plan.truth = Truth::None;
}

/// A spot that a shiny surface makes. It is dimmer, so the higher spot is the laser's.
pub fn second_reflection(plan: &mut Plan, random: &mut Rng) {
    let share = random.random_range(0.2..0.75);
    let offset = side(random) * random.random_range(1.5..6.0);
    let widths = random.random_range(0.8..1.5);
    plan.leave_room(0.4 * plan.spot.height);
    add_spot(plan, share, offset, widths);
}

/// Adds a spot of the same shape that moves with it: height as a share, distance and width in its widths.
pub fn add_spot(plan: &mut Plan, share: f64, offset: f64, widths: f64) {
    plan.light.add(move |pixels, moment, _| {
        let spot = moment.spot;
        let other = Spot {
            height: share * spot.height,
            centre: spot.centre + offset * spot.width,
            width: widths * spot.width,
            ..spot
        };
        other.add_to(pixels, |_| 1.0);
    });
}

/// A laser mode with a hole in its middle. The spot stays symmetric, so its centre is certain.
pub fn donut(plan: &mut Plan, random: &mut Rng) {
    let depth = random.random_range(0.2..0.95);
    let width = random.random_range(0.2..0.6) * plan.spot.width;
    let centre = plan.spot.centre;
    // The hole belongs to the spot, and moves with it.
    plan.speed = 0.0;
    plan.glass(move |place| 1.0 - depth * gaussian(place, centre, width));
}
