//! A range of brightness with one setting: the errors of auto exposure beside those of fixed exposures.

use super::jumps::LEAST_POWER;
use super::{BRIGHTEST, Comparison, Sensor, scene};
use rayon::prelude::*;
use serde::Serialize;
use simulator::scene::Scene;
use simulator::with;
use slitrange::base::exposure::{Exposure, ExposureMode};
use slitrange::light::auto_exposure::{LEAST_PERCENT, TARGET_PERCENT};
use slitrange::measurement::Options;
use statistics::{mean, rms};

/// Frames that a sensor has to settle before frames count.
const TO_SETTLE: usize = 3;
/// The ratio of two neighbours of the fixed exposures.
const STEP: f64 = 1.1;
/// The number of fixed exposures: 1.1^22 = 8.
const STEPS: i32 = 22;
/// The charge of a pixel in counts beyond which the fixed exposures need not go: the spot is then saturated
/// (4096 counts less a black level of 300).
const SATURATED: f64 = 3900.0;
/// The height of a low spot whose exposure stays, in percent of the room. Noise does not take it below
/// [`LEAST_PERCENT`].
const LOWEST_PERCENT: u32 = LEAST_PERCENT + 3;

/// What frames of one exposure and one target came out as.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Frames {
    /// The exposure of the last frame.
    pub exposure_us: u16,
    /// Frames.
    pub frames: usize,
    /// Frames with a fault.
    pub faults: usize,
    /// Readings with a flag.
    pub flagged: usize,
    /// Root mean square error in micrometres, of the readings without a flag.
    pub rms_um: f64,
    /// The mean error in micrometres.
    pub bias_um: f64,
    /// The mean repeatability r that they claim, in micrometres.
    pub r_um: f64,
    /// How many of them have an error beyond twice what the rows claim.
    pub beyond_2: usize,
    /// How many of them have an error beyond five times what the rows claim.
    pub beyond_5: usize,
}

impl Frames {
    /// Lets the sensor settle, and measures frames.
    pub(super) fn measure(sensor: &mut Sensor, reflectivity: f64, frames: usize) -> Self {
        sensor.frames(reflectivity, TO_SETTLE);
        let results = sensor.frames(reflectivity, frames);
        let readings = results.iter().flatten();
        let exposure = readings.clone().last().and_then(|it| it.frame.exposure);
        let compared = readings.map(|measured| sensor.compare(measured));
        let (flagged, good): (Vec<_>, Vec<_>) = compared.partition(|it| it.is_flagged);
        let claims = good.iter().map(Comparison::error_over_claim);
        let beyond = |most| claims.clone().filter(|&it| it > most).count();
        Self {
            exposure_us: exposure.map_or(0, Exposure::us),
            frames,
            faults: frames - good.len() - flagged.len(),
            flagged: flagged.len(),
            rms_um: rms(good.iter().map(|it| it.error_um)),
            bias_um: mean(good.iter().map(|it| it.error_um)),
            r_um: mean(good.iter().map(|it| it.r_um)),
            beyond_2: beyond(2.0),
            beyond_5: beyond(5.0),
        }
    }

    /// Readings without a flag.
    pub fn readings(&self) -> usize {
        self.frames - self.faults - self.flagged
    }
}

/// One target: auto exposure and fixed exposures.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Target {
    /// The reflectivity: 1 is bright metal, 1e-4 is black tape.
    pub reflectivity: f64,
    /// Auto exposure, that begins with the longest exposure. The spot then has 70 % of its room.
    pub auto: Frames,
    /// Auto exposure after a target that is brighter by 70 % over `LOWEST_PERCENT`. The exposure stays, and
    /// the spot is about as low as auto exposure lets it be.
    pub auto_lowest: Frames,
    /// The fixed exposure with the smallest RMS error and without faults.
    pub best: Frames,
    /// The longest exposure, if it gives no faults.
    pub longest: Option<Frames>,
}

impl Target {
    /// Measures a target with all exposures, with this many frames each. All exposures have the same noise,
    /// and each `seed` has other noise.
    pub fn measure(reflectivity: f64, frames: usize, seed: u64) -> Self {
        let sensor = |exposure| {
            let options = with(Options::default(), |it| it.exposure = exposure);
            Sensor::new(Scene { seed, ..scene() }, options)
        };
        let auto = Frames::measure(&mut sensor(ExposureMode::Auto), reflectivity, frames);
        let fixed = |exposure| {
            let mut sensor = sensor(ExposureMode::Fixed(exposure));
            Frames::measure(&mut sensor, reflectivity, frames)
        };
        let mut sensor = sensor(ExposureMode::Auto);
        let brighter = f64::from(TARGET_PERCENT) / f64::from(LOWEST_PERCENT);
        sensor.frames(reflectivity * brighter, TO_SETTLE);
        let auto_lowest = Frames::measure(&mut sensor, reflectivity, frames);
        let longest = fixed(Exposure::LONGEST);
        let fixed = fixed_exposures(reflectivity).map(fixed).chain([longest]);
        let best = fixed
            .filter(|it| it.faults == 0)
            .min_by(|a, b| a.rms_um.total_cmp(&b.rms_um));
        Self {
            reflectivity,
            auto,
            auto_lowest,
            best: best.unwrap_or(longest),
            longest: (longest.faults == 0).then_some(longest),
        }
    }

    /// The RMS error of auto exposure over that of the best fixed exposure.
    pub fn ratio(&self) -> f64 {
        self.auto.rms_um / self.best.rms_um
    }

    /// As [`Target::ratio`], of a spot as low as auto exposure lets it be.
    pub fn ratio_of_lowest(&self) -> f64 {
        self.auto_lowest.rms_um / self.best.rms_um
    }
}

/// Exposures a tenth apart, from the one that saturates the spot down to an eighth of it. Shorter ones have
/// larger errors.
fn fixed_exposures(reflectivity: f64) -> impl Iterator<Item = Exposure> {
    let saturates_us = SATURATED / (BRIGHTEST * reflectivity) * 1e6;
    let longest_us = saturates_us.min(Exposure::LONGEST.us().into());
    let exposure = |step: i32| Exposure::nearest_to_us((longest_us * STEP.powi(-step)) as u32);
    let mut exposures: Vec<_> = (0..=STEPS).map(exposure).collect();
    exposures.dedup();
    exposures.into_iter()
}

/// So many targets of the range, evenly in the logarithm, the brightest first.
pub fn targets(count: usize, frames: usize, done: &(dyn Fn() + Sync)) -> Vec<Target> {
    (0..count)
        .into_par_iter()
        .map(|number| {
            let share = number as f64 / (count - 1) as f64;
            let target = Target::measure(10f64.powf(LEAST_POWER * share), frames, number as u64);
            done();
            target
        })
        .collect()
}

/// The middle of the range, 1000 : 1. There, auto exposure may have 1.5 times the error of the best exposure.
pub fn is_in_middle(reflectivity: f64) -> bool {
    (0.999e-3..=1.001).contains(&(reflectivity * 10f64.sqrt()))
}
