//! Faults of the amplifier between sensor and converter.

use crate::second_judge::plan::Plan;
use crate::second_judge::{Rng, log_even, side};
use rand::Rng as _;

/// An amplifier that settles too slowly, overshoots or rings: each pixel gets a share of what a pixel shortly
/// before it shows. The share's share follows at twice the delay, and so on.
///
/// The pixels come in one order, so the echo lies on one side. The truth reaches from the spot's centre to
/// the centroid of spot and echoes. Echoes of share s and delay d move the centroid by the sum of k d s^k
/// over the sum of s^k, which is d s / (1 - s).
pub fn echo(plan: &mut Plan, random: &mut Rng) {
    let share = side(random) * log_even(random, 0.02, 0.15);
    let delay = random.random_range(1..=3);
    let black = plan.sensor.black;
    plan.leave_share(0.2);
    let centroid = plan.spot.centre + delay as f64 * share / (1.0 - share);
    plan.truth = plan.truth.reaching(centroid);
    plan.volts.add(move |pixels, _, _| {
        for i in delay..pixels.len() {
            pixels[i] += share * (pixels[i - delay] - black);
        }
    });
}
