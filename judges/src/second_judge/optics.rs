//! Faults between the slit and the pixels: dust, ghosts, fringes, other light.

use crate::second_judge::plan::{Plan, add};
use crate::second_judge::target::add_spot;
use crate::second_judge::{Rng, gaussian, log_even, side};
use rand::Rng as _;
use rand::seq::index;
use rand_distr::{Distribution as _, StandardNormal};
use std::f64::consts::{LN_2, TAU};

/// Dust on the cover glass, as wide as a flank of the spot. Its shadow is not sharp, because the light comes
/// from the whole slit. The truth is the centre of the light without the dust.
pub fn dust_wide(plan: &mut Plan, random: &mut Rng) {
    let width = random.random_range(0.5..1.5);
    let depth = random.random_range(0.05..0.6);
    dust(plan, random, width, depth);
}

/// Dust narrower than a flank.
pub fn dust_narrow(plan: &mut Plan, random: &mut Rng) {
    let width = random.random_range(0.2..0.5);
    let depth = random.random_range(0.05..0.9);
    dust(plan, random, width, depth);
}

/// A shadow 0.4 to 2 widths of the spot from its centre. `width` is that of a gaussian shadow (sigma) in
/// widths of the spot. Sharper shadows have the same half-depth width.
fn dust(plan: &mut Plan, random: &mut Rng, width: f64, depth: f64) {
    let spot = plan.spot;
    let place = spot.centre + side(random) * random.random_range(0.4..2.0) * spot.width;
    let half = (2.0 * LN_2).sqrt() * width * spot.width;
    // exp(-ln 2 |x|^p) is one half at x = 1: a gaussian with p = 2, nearly a box with p = 6.
    let power = log_even(random, 2.0, 6.0);
    plan.glass(move |x| 1.0 - depth * (-LN_2 * ((x - place).abs() / half).powf(power)).exp());
}

/// Speckle whose grain is finer than the spot, as a wide laser spot makes it. The truth is the centre of the
/// light without the grain.
pub fn grain(plan: &mut Plan, random: &mut Rng) {
    // Waves of random direction and phase add up to a normal random field.
    const WAVES: usize = 24;
    let contrast = log_even(random, 0.05, 0.4);
    let length = log_even(random, 0.1, 0.5) * plan.spot.width;
    let waves: Vec<(f64, f64)> = (0..WAVES)
        .map(|_| {
            let normal: f64 = StandardNormal.sample(random);
            (normal / length, TAU * random.random::<f64>())
        })
        .collect();
    let scale = contrast * (2.0 / WAVES as f64).sqrt();
    plan.leave_room(contrast * plan.spot.height);
    plan.glass(move |x| {
        let field: f64 = waves.iter().map(|(k, phase)| (k * x + phase).cos()).sum();
        (1.0 + scale * field).max(0.0)
    });
}

/// A reflection between cover glass and sensor.
pub fn weak_ghost(plan: &mut Plan, random: &mut Rng) {
    let share = log_even(random, 0.01, 0.06);
    let offset = side(random) * random.random_range(1.0..5.0);
    let widths = random.random_range(0.8..2.0);
    add_spot(plan, share, offset, widths);
}

/// A ghost in all rows, and 3 to 6 of 16 rows that a frame leaves out: the spot jumps in them, or up to four
/// pixels on it are too bright. A single row has the ghost alone. The truth is the centre of the light
/// without the ghost.
pub fn ghost_and_outliers(plan: &mut Plan, random: &mut Rng) {
    plan.spot.height = random.random_range(1500.0..3000.0);
    let share = random.random_range(0.02..0.05);
    let offset = side(random) * random.random_range(0.8..2.0);
    let widths = random.random_range(0.8..2.0);
    add_spot(plan, share, offset, widths);
    if plan.rows == 1 {
        return;
    }
    let count = random.random_range(3..=6);
    let rows = index::sample(random, plan.rows, count).into_vec();
    if random.random_bool(0.5) {
        plan.shifts = vec![0.0; plan.rows];
        for row in rows {
            plan.shifts[row] = side(random) * random.random_range(0.5..3.0) * plan.spot.width;
        }
        return;
    }
    plan.volts.add(move |pixels, moment, random| {
        let spot = moment.spot;
        let first = (spot.centre + random.random_range(-1.5..1.5) * spot.width) as usize;
        let bright = first..first + random.random_range(1..=4);
        let counts = log_even(random, 300.0, 1000.0);
        if rows.contains(&moment.row) {
            add(&mut pixels[bright], |_| counts);
        }
    });
}

/// Interference in the cover glass. A glass of 0.7 mm has fringes of 8 to 25 pixels at 45 to 10 degrees.
pub fn fringes(plan: &mut Plan, random: &mut Rng) {
    let depth = log_even(random, 0.01, 0.08);
    let period = log_even(random, 5.0, 40.0);
    let phase = TAU * random.random::<f64>();
    plan.leave_room(depth * plan.spot.height);
    plan.glass(move |x| 1.0 + depth * (TAU * x / period + phase).sin());
}

/// Light that the target scatters below its surface. It is symmetric, so the centre is certain.
pub fn halo(plan: &mut Plan, random: &mut Rng) {
    let share = log_even(random, 0.02, 0.3);
    let widths = random.random_range(2.5..10.0);
    plan.leave_room(share * plan.spot.height);
    add_spot(plan, share, 0.0, widths);
}

/// Scattered light in the housing.
pub fn veil(plan: &mut Plan, random: &mut Rng) {
    let share = log_even(random, 0.01, 0.2);
    let widths = random.random_range(3.0..10.0);
    let offset = side(random) * random.random_range(0.0..6.0);
    plan.leave_room(share * plan.spot.height);
    add_spot(plan, share, offset, widths);
}

/// A lamp behind the slit.
pub fn lamp(plan: &mut Plan, random: &mut Rng) {
    let share = log_even(random, 0.05, 0.6);
    let width = random.random_range(2.5..15.0) * plan.spot.width;
    let centre = plan.spot.centre + side(random) * random.random_range(0.0..2.0) * width;
    plan.leave_room(share * plan.spot.height);
    let height = share * plan.spot.height;
    plan.add_light(move |i| height * gaussian(i, centre, width));
}
