//! Faults of the analog signal, and light that changes all of it.

use crate::second_judge::plan::{Plan, add};
use crate::second_judge::sensor::FULL_SCALE;
use crate::second_judge::{Rng, gaussian, log_even, side};
use rand::Rng as _;
use rand_distr::{Distribution as _, StandardNormal};
use std::f64::consts::TAU;

/// A level that rises along the row. It is the sensor's black level where the level is lowest.
pub fn slope(plan: &mut Plan, random: &mut Rng) {
    let slope = side(random) * log_even(random, 0.02, 2.0);
    let last = plan.sensor.pixels as f64 - 1.0;
    let lowest = (slope * last).min(0.0);
    plan.leave_room((slope * last).abs());
    plan.add_volts(move |i| slope * i - lowest);
}

/// A level that falls below the converter's zero near the spot, which clips one flank's foot.
pub fn clipped(plan: &mut Plan, random: &mut Rng) {
    let slope = side(random) * log_even(random, 0.05, 3.0);
    let zero = plan.spot.centre - slope.signum() * random.random_range(0.0..4.0) * plan.spot.width;
    let black = plan.sensor.black;
    plan.leave_room(slope.abs() * plan.sensor.pixels as f64);
    plan.add_volts(move |i| slope * (i - zero) - black);
}

/// A level that jumps within the spot and stays.
pub fn step(plan: &mut Plan, random: &mut Rng) {
    let counts = side(random) * log_even(random, 3.0, 60.0);
    let from = plan.spot.centre + random.random_range(-3.0..3.0) * plan.spot.width;
    plan.leave_room(60.0);
    plan.volts.add(move |pixels, _, _| {
        let pixels = pixels.iter_mut().skip(from as usize);
        pixels.for_each(|pixel| *pixel += counts);
    });
}

/// A lamp on the mains, which lights the row unevenly. Rows come every 5.7 ms.
pub fn flicker(plan: &mut Plan, random: &mut Rng) {
    let counts = log_even(random, 20.0, 600.0);
    let gradient = random.random_range(-0.5..0.5);
    let phase = TAU * random.random::<f64>();
    let pixels = plan.sensor.pixels as f64;
    plan.leave_room(1.5 * counts);
    plan.light.add(move |light, moment, _| {
        let wave = (TAU * 100.0 * 5.7e-3 * moment.row as f64 + phase).sin();
        let level = 0.5 * counts * (1.0 + wave);
        add(light, |i| {
            level * (1.0 + 2.0 * gradient * (i / pixels - 0.5))
        });
    });
}

/// A supply or a clock that is locked to the read-out: it has the same phase in every row.
pub fn ripple(plan: &mut Plan, random: &mut Rng) {
    let counts = plan.spot.height * log_even(random, 0.005, 0.12);
    let period = log_even(random, 4.0, 150.0);
    let phase = TAU * random.random::<f64>();
    plan.leave_room(counts);
    plan.add_volts(move |i| counts * (TAU * i / period + phase).sin());
}

/// A short oscillation, as a switching load makes it at the same time in every row.
pub fn burst(plan: &mut Plan, random: &mut Rng) {
    let spot = plan.spot;
    let counts = spot.height * log_even(random, 0.03, 0.25);
    let period = log_even(random, 2.0, 20.0);
    let phase = TAU * random.random::<f64>();
    let length = random.random_range(0.5..3.0) * spot.width;
    let centre = spot.centre + random.random_range(-2.5..2.5) * spot.width;
    plan.leave_room(counts);
    plan.add_volts(move |i| {
        counts * gaussian(i, centre, 0.4 * length) * (TAU * i / period + phase).sin()
    });
}

/// Noise of the amplifier below the pixel rate: each pixel's depends on the one before.
pub fn slow_noise(plan: &mut Plan, random: &mut Rng) {
    let deviation = plan.sensor.read_noise * log_even(random, 0.5, 4.0);
    let kept = (-1.0 / log_even(random, 3.0, 60.0)).exp();
    let fresh = deviation * (1.0 - kept * kept).sqrt();
    plan.volts.add(move |pixels, _, random| {
        let first: f64 = StandardNormal.sample(random);
        let mut level = deviation * first;
        for pixel in pixels {
            *pixel += level;
            let normal: f64 = StandardNormal.sample(random);
            level = kept * level + fresh * normal;
        }
    });
}

/// Sparks: other pixels in each row.
pub fn impulses(plan: &mut Plan, random: &mut Rng) {
    let share = log_even(random, 0.001, 0.03);
    plan.volts.add(move |pixels, _, random| {
        for pixel in pixels {
            if random.random_bool(share) {
                *pixel = random.random_range(0.0..FULL_SCALE);
            }
        }
    });
}
