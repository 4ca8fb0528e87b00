//! Spots that are not symmetric, and double spots. All places from the peak to the centroid are right, except
//! for the glass plate.

use crate::hard_cases::Truth;
use crate::second_judge::plan::Plan;
use crate::second_judge::spot::{Shape, Spot};
use crate::second_judge::target::add_spot;
use crate::second_judge::{Rng, side};
use rand::Rng as _;
use std::f64::consts::FRAC_1_SQRT_2;

/// The peak and the centroid of light about a spot, and all between. Light further than 5 widths away counts
/// for nothing: only side lobes are there.
fn from_peak_to_centroid(spot: &Spot, light: impl Fn(f64) -> f64) -> Truth {
    const STEPS: i32 = 200;
    let place = |i| spot.centre + spot.width * f64::from(i) / f64::from(STEPS);
    let lights = || (-5 * STEPS..=5 * STEPS).map(|i| (place(i), light(place(i))));
    let (peak, _) = lights().fold((0.0, 0.0), |a, b| if b.1 > a.1 { b } else { a });
    let (sum, moment) = lights().fold((0.0, 0.0), |(sum, moment), (place, light)| {
        (sum + light, moment + light * place)
    });
    Truth::Centre(peak).reaching(moment / sum)
}

/// An edge between two reflectivities of the target, under the spot. The slit's blur makes it soft.
///
/// The centre of the laser spot cannot be told from the light alone: the same light comes from a lopsided
/// spot on an even target. So the truth is that of lopsided light, from its peak to its centroid.
pub fn reflectivity(plan: &mut Plan, random: &mut Rng) {
    let spot = plan.spot;
    let dimmer = 1.0 - random.random_range(0.2..0.8);
    let place = spot.centre + random.random_range(-1.5..1.5) * spot.width;
    let blur = side(random) * random.random_range(0.1..0.4) * spot.width;
    let glass =
        move |x: f64| 1.0 - dimmer * 0.5 * (1.0 + libm::erf(FRAC_1_SQRT_2 * (x - place) / blur));
    // The truth holds for all rows.
    plan.speed = 0.0;
    plan.truth = from_peak_to_centroid(&spot, |x| spot.at(x) * glass(x));
    plan.glass(glass);
}

/// A laser whose mode got uneven after the calibration: two lobes that merge to one top. The truth is from
/// the peak to the centroid of both.
pub fn two_lobes(plan: &mut Plan, random: &mut Rng) {
    let share = random.random_range(0.3..0.9);
    let offset = side(random) * random.random_range(0.6..1.6);
    plan.spot.shape = Shape::gaussian();
    plan.leave_share(share);
    plan.calibrate(random);
    let spot = plan.spot;
    plan.truth = from_peak_to_centroid(&spot, |x| {
        spot.at(x) + share * spot.at(x - offset * spot.width)
    });
    add_spot(plan, share, offset, 1.0);
}

/// A target into which light enters, and leaves further on: an exponential tail to one side. The truth is
/// from the spot's centre to the centroid of all light.
pub fn translucent(plan: &mut Plan, random: &mut Rng) {
    let share = random.random_range(0.05..0.5);
    let kept = (-1.0 / (random.random_range(0.5..4.0) * plan.spot.width)).exp();
    let is_right = random.random_bool(0.5);
    // The tail is a sum over the pixels before: of the k-th comes kept^k, k from 0 on. Its mean delay is:
    let delay = kept / (1.0 - kept);
    let moved = if is_right { share } else { -share } * delay;
    plan.truth = plan.truth.reaching(plan.spot.centre + moved);
    plan.light.add(move |pixels, _, _| {
        let mut tail = 0.0;
        let mut spread = |pixel: &mut f64| {
            tail = kept * tail + (1.0 - kept) * *pixel;
            *pixel += share * (tail - *pixel);
        };
        match is_right {
            true => pixels.iter_mut().for_each(&mut spread),
            false => pixels.iter_mut().rev().for_each(&mut spread),
        }
    });
}

/// A glass plate: its back reflects as much light as its front, so close that both spots merge.
///
/// Only the front's place is right: the truth is the first spot's centre. The merged spot is symmetric, or
/// nearly. So only its width tells that something is wrong, and only to a sensor whose calibration learned
/// its own spot. A sensor that was never calibrated cannot know.
pub fn glass_plate(plan: &mut Plan, random: &mut Rng) {
    let share = random.random_range(0.9..1.1);
    let offset = side(random) * random.random_range(0.8..2.5);
    plan.leave_share(share);
    add_spot(plan, share, offset, 1.0);
}
