//! Light that is wider than the spot, on a row as long as that of a TCD1304DG or under a narrow spot.

use crate::second_judge::plan::Plan;
use crate::second_judge::{Rng, gaussian, log_even};
use rand::Rng as _;

/// Pixels of a TCD1304DG that see light.
const PIXELS: usize = 3648;

/// A lamp or a second light far from the spot. The spot is higher, so it is the laser's. The truth is the
/// spot's centre.
pub fn wider_light(plan: &mut Plan, random: &mut Rng) {
    let width = log_even(random, 30.0, 170.0);
    let height = log_even(random, 60.0, 3000.0);
    let share = 1.0 / random.random_range(1.35..5.0);
    add_beside(plan, random, width, share * height, height);
}

/// A faint light so wide that the search for the spot may take it for the spot: the light has more charge.
/// The truth is the spot's centre.
pub fn hides_dim_spot(plan: &mut Plan, random: &mut Rng) {
    let width = random.random_range(150.0..180.0);
    let counts = random.random_range(20.0..100.0);
    let height = random.random_range(60.0..200.0);
    add_beside(plan, random, width, counts, height);
}

/// Puts a spot of the default optics' width on a long row, and a gaussian light of a width and height beside.
fn add_beside(plan: &mut Plan, random: &mut Rng, width: f64, counts: f64, height: f64) {
    plan.sensor.pixels = PIXELS;
    plan.spot.width = random.random_range(7.0..9.0);
    // Far enough from the ends of the row: another kind has spots there.
    plan.place(random.random_range(60.0..PIXELS as f64 - 60.0));
    plan.spot.height = height;
    plan.calibrate(random);
    let spot = plan.spot;
    // The row is six times as long as the widest light is kept off, so a few draws find a place.
    let centre = loop {
        let centre = random.random_range(0.0..PIXELS as f64);
        if (centre - spot.centre).abs() >= 3.0 * width + 6.0 * spot.width {
            break centre;
        }
    };
    plan.add_light(move |i| counts * gaussian(i, centre, width));
}

/// A narrow spot on the light of a lamp. The lamp's light slopes under the spot. The truth is the spot's
/// centre.
pub fn wide_lamp(plan: &mut Plan, random: &mut Rng) {
    let share = random.random_range(0.3..0.7);
    let width = random.random_range(60.0..150.0);
    let centre = plan.spot.centre + random.random_range(-2.0..2.0) * width;
    plan.spot.width = log_even(random, 2.0, 8.0);
    plan.spot.height = log_even(random, 300.0, 3000.0);
    plan.leave_share(share);
    plan.calibrate(random);
    let counts = share * plan.spot.height;
    plan.add_light(move |i| counts * gaussian(i, centre, width));
}

/// Few photons on a pedestal: noise may make the measured width of the spot's shape negative. The pedestal
/// has the spot's centre, so the centre is certain.
pub fn few_photons(plan: &mut Plan, random: &mut Rng) {
    plan.sensor.electrons = random.random_range(4.0..12.0);
    plan.spot.height = log_even(random, 30.0, 200.0);
    plan.calibrate(random);
    let spot = plan.spot;
    let counts = log_even(random, 0.2, 2.0) * spot.height;
    let width = random.random_range(10.0..40.0) * spot.width;
    plan.add_light(move |i| counts * gaussian(i, spot.centre, width));
}
