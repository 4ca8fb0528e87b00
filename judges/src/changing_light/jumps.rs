//! Jumps of a target's brightness: how many frames they cost, and whether a reading is wrong.

use super::{Sensor, scene};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;
use simulator::with;
use slitrange::{Fault, Measured, Options};

/// The least reflectivity, in powers of ten: that of black tape. The highest is 1, bright metal.
pub const LEAST_POWER: f64 = -4.0;
/// Jumps of one sensor. A million jumps are those of a thousand sensors.
const OF_A_SENSOR: u64 = 1000;

/// What came out of random jumps.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Jumps {
    /// Jumps.
    pub jumps: u64,
    /// Complete frames.
    pub frames: u64,
    /// Readings with a flag.
    pub flagged: u64,
    /// Faults of the frames in which the target changed, by [`Fault::kind`].
    pub first_faults: [u64; Fault::KINDS],
    /// Faults of all other frames, by [`Fault::kind`].
    pub later_faults: [u64; Fault::KINDS],
    /// Readings without a flag whose error is beyond 5u.
    pub beyond_5u: u64,
    /// Readings without a flag whose error is beyond five times what the rows claim.
    pub beyond_5_claims: u64,
    /// The largest error of a reading without a flag.
    pub worst: Worst,
    /// The largest error over the claim of the rows.
    pub worst_over_claim: Worst,
}

/// The reading with the largest error.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Worst {
    /// The error over u or over the claim of the rows.
    pub ratio: f64,
    /// The number of the sensor.
    pub sensor: u64,
    /// The reflectivities before and after the jump.
    pub jump: [f64; 2],
    /// Whether the target changed in the frame.
    pub is_first: bool,
}

impl Worst {
    fn or(self, other: Self) -> Self {
        match other.ratio > self.ratio {
            true => other,
            false => self,
        }
    }
}

impl Jumps {
    /// This many random jumps, on all cores. Each sensor has a thousand of them and its own random numbers,
    /// so the number of cores changes no result. Calls `done` with the jumps of each sensor.
    pub fn run(jumps: u64, done: &(dyn Fn(u64) + Sync)) -> Self {
        (0..jumps.div_ceil(OF_A_SENSOR))
            .into_par_iter()
            .map(|sensor| {
                let count = OF_A_SENSOR.min(jumps - sensor * OF_A_SENSOR);
                let found = Self::of_sensor(sensor, count);
                done(count);
                found
            })
            .reduce(Self::default, Self::and)
    }

    /// The jumps of one sensor between any two reflectivities, evenly in the logarithm. The target changes
    /// anywhere in a frame. The next change comes after one more whole frame.
    pub fn of_sensor(number: u64, jumps: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(number);
        let scene = with(scene(), |it| it.seed = random.random());
        let mut sensor = Sensor::new(scene, Options::default());
        let mut found = Self::default();
        let mut before = 1.0;
        for _ in 0..jumps {
            let reflectivity = 10f64.powf(LEAST_POWER * random.random::<f64>());
            found.jumps += 1;
            for is_first in [true, false] {
                let place = Worst {
                    ratio: 0.0,
                    sensor: number,
                    jump: [before, reflectivity],
                    is_first,
                };
                for result in sensor.frames(reflectivity, 1) {
                    found.take(&sensor, result, place);
                }
            }
            // The next jump comes anywhere in a frame: these rows do not end it.
            for _ in 0..random.random_range(0..Options::default().rows) {
                sensor.row(reflectivity);
            }
            before = reflectivity;
        }
        found
    }

    fn take(&mut self, sensor: &Sensor, result: Result<Measured, Fault>, place: Worst) {
        self.frames += 1;
        let comparison = match result {
            Ok(measured) => sensor.compare(&measured),
            Err(fault) if place.is_first => return self.first_faults[fault.kind()] += 1,
            Err(fault) => return self.later_faults[fault.kind()] += 1,
        };
        if comparison.is_flagged {
            self.flagged += 1;
            return;
        }
        let at = |ratio| Worst { ratio, ..place };
        let (over_u, over_claim) = (comparison.error_over_u(), comparison.error_over_claim());
        self.beyond_5u += u64::from(over_u > 5.0);
        self.beyond_5_claims += u64::from(over_claim > 5.0);
        self.worst = self.worst.or(at(over_u));
        self.worst_over_claim = self.worst_over_claim.or(at(over_claim));
    }

    fn and(self, other: Self) -> Self {
        let sums = |a: [u64; Fault::KINDS], b: [u64; Fault::KINDS]| {
            std::array::from_fn(|kind| a[kind] + b[kind])
        };
        Self {
            jumps: self.jumps + other.jumps,
            frames: self.frames + other.frames,
            flagged: self.flagged + other.flagged,
            first_faults: sums(self.first_faults, other.first_faults),
            later_faults: sums(self.later_faults, other.later_faults),
            beyond_5u: self.beyond_5u + other.beyond_5u,
            beyond_5_claims: self.beyond_5_claims + other.beyond_5_claims,
            worst: self.worst.or(other.worst),
            worst_over_claim: self.worst_over_claim.or(other.worst_over_claim),
        }
    }
}

/// The faults that came, with their names.
pub fn named(faults: &[u64; Fault::KINDS]) -> Vec<(&'static str, u64)> {
    let all = Fault::NAMES.into_iter().zip(*faults);
    all.filter(|&(_, count)| count > 0).collect()
}
