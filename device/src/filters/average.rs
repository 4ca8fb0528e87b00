//! The filter of the setting `average`: one distance from the latest readings.
//!
//! The window is the last N results. A fault takes a place in the window and gives no distance, so the filter
//! forgets what came before N faults in succession.
//!
//! | filter | distance | variance of the noise |
//! |---|---|---|
//! | moving | mean of the window | sum of r^2 / n^2 |
//! | median | median of the window; of an even number, the mean of the middle two | pi/2 times that |
//! | recursive | moves to each reading by 1/k of the way | (1 - 1/k)^2 times itself + r^2 / k^2 |
//!
//! n is the number of readings in the window. k counts the readings up to N, so the filter begins with the
//! mean of the first N; later its variance goes to 1/(2N - 1) of a reading's. Pi/2 is the variance of the
//! median over that of the mean of many gaussian values. For three or more it is an upper limit; the median
//! of one or two is their mean.
//!
//! **Noise and the rest.** Successive readings share no row, so their noise is independent and shrinks. They
//! share all else for a target at rest: calibration, pixels, geometry, shape, speckle. The errors of these
//! parts count as the same in all readings, and the part of a mean is the mean of the parts. Only the noise
//! of `ambient subtract` is shared by rows of several frames: see [`Filter::take`].
//!
//! **Flags.** A flag of a reading stays while the reading is in the window. A recursive mean also holds older
//! readings: the latest N have about 63 % of the weight. So there a flag stays until the readings that have
//! it are out of the window and have less than 1 % of the weight: 4.6 N results after the last of many, and N
//! ln(100 / N) results after one alone, if that is more than N.
//!
//! Of a moving target the distance is late: by (N - 1)/2 frames, or N - 1 frames if the filter is recursive.

use core::f32::consts::FRAC_PI_2;

use slitrange::base::order_statistic::{from_ordered, ordered, ranked};
use slitrange::reading::uncertainty::Parts;
use slitrange::{Fault, Micrometres, Reading};

/// The longest window, in results.
pub const LONGEST: u8 = 64;

/// How readings are averaged, and over how many results.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Average {
    /// Each reading by itself.
    #[default]
    None,
    /// The mean of the last ones.
    Moving(u8),
    /// The median of the last ones.
    Median(u8),
    /// A mean that gives the latest reading the weight 1/N, and forgets the others.
    Recursive(u8),
}

/// What the filter needs of a reading.
#[derive(Clone, Copy, Debug)]
struct Sample {
    distance: Micrometres,
    parts: Parts,
    misfits: u16,
    correlated: Option<u16>,
}

/// A distance as the raw integer of [`Micrometres`], with the parts of its uncertainty.
#[derive(Clone, Copy, Debug)]
struct Mean {
    /// With [`EXTRA`] more bits after the binary point.
    distance: i64,
    /// In micrometres squared.
    noise_variance: f32,
    /// The means of the parts in the window. That of the noise is the noise of readings which share it.
    parts: Parts,
    /// The most misfits of a reading; 0 without the flag.
    misfits: u16,
    /// The fewest independent rows of a reading with the flag.
    correlated: Option<u16>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Recursive {
    /// As in [`Mean`].
    distance: i64,
    /// As in [`Mean`].
    noise_variance: f32,
    /// The readings in it, up to N.
    count: u8,
    misfits: Flag,
    correlated: Flag,
}

/// A flag of the readings in a recursive mean.
#[derive(Clone, Copy, Debug, Default)]
struct Flag {
    /// The worst number with the flag.
    worst: Option<u16>,
    /// The weight of the readings with the flag, 0 to 1.
    weight: f32,
}

impl Flag {
    /// Below this weight of its readings, a flag ends.
    const LEAST_WEIGHT: f32 = 0.01;

    /// The flag after another reading, of this weight. `in_window` is the worst number in the window.
    fn after(
        self,
        is_set: bool,
        weight: f32,
        in_window: Option<u16>,
        worse: fn(u16, u16) -> u16,
    ) -> Self {
        let new = if is_set { weight } else { 0.0 };
        let weight = (1.0 - weight) * self.weight + new;
        let before = self.worst.filter(|_| weight >= Self::LEAST_WEIGHT);
        let worst = match (before, in_window) {
            (Some(before), Some(in_window)) => Some(worse(before, in_window)),
            (before, in_window) => before.or(in_window),
        };
        Self { worst, weight }
    }
}

/// More bits of a recursive distance, so that 1/64 of a step is not lost.
const EXTRA: u32 = 16;

/// The filter's state.
#[derive(Clone, Debug)]
pub struct Filter {
    average: Average,
    window: [Option<Sample>; LONGEST as usize],
    next: usize,
    recursive: Option<Recursive>,
}

impl Default for Filter {
    fn default() -> Self {
        Self {
            average: Average::None,
            window: [None; LONGEST as usize],
            next: 0,
            recursive: None,
        }
    }
}

impl Filter {
    /// Forgets all readings.
    pub fn clear(&mut self) {
        // In place: the window has 2.6 KB.
        self.window.fill(None);
        self.next = 0;
        self.recursive = None;
    }

    /// Takes a result. Returns the filter's reading, or the fault. Another `average` starts the filter again.
    ///
    /// `is_ambient_subtracted`: each row then has the noise of the mean of many dark rows, and so has the
    /// next row. In steady light a row takes dark rows with weights whose sum is 1, and a dark row goes into
    /// all rows with weights whose sum is 1 at most. So the dark rows add to the noise of any mean of rows at
    /// most as much variance as the rows with the laser on have themselves.
    pub fn take(
        &mut self,
        average: Average,
        is_ambient_subtracted: bool,
        result: Result<Reading, Fault>,
    ) -> Result<Reading, Fault> {
        if average != self.average {
            self.average = average;
            self.clear();
        }
        let length = match average {
            Average::None => return result,
            Average::Moving(n) | Average::Median(n) | Average::Recursive(n) => n.clamp(1, LONGEST),
        };
        if let Some(place) = self.window.get_mut(self.next) {
            *place = result.ok().map(|reading| Sample {
                distance: reading.distance,
                parts: reading.parts,
                misfits: reading.misfits,
                correlated: reading.correlated,
            });
        }
        self.next = self.next.saturating_add(1);
        if self.next >= usize::from(length) {
            self.next = 0;
        }
        if self.samples().next().is_none() {
            self.recursive = None;
        }
        let reading = result?;
        let mean = match average {
            Average::None | Average::Moving(_) => self.mean(),
            Average::Median(_) => self.median(),
            Average::Recursive(_) => self.recursive_mean(&reading, length),
        };
        Ok(self.reading(&mean, is_ambient_subtracted, reading))
    }

    fn samples(&self) -> impl Iterator<Item = &Sample> {
        self.window.iter().flatten()
    }

    /// The readings in the window, at least 1, at most [`LONGEST`].
    fn count(&self) -> u8 {
        let count = self.samples().fold(0u8, |count, _| count.saturating_add(1));
        count.max(1)
    }

    fn mean(&self) -> Mean {
        let count = self.count();
        let squares = |it: &Sample| it.parts.noise.to_f32() * it.parts.noise.to_f32();
        let squares: f32 = self.samples().map(squares).sum();
        // 64 values of 31 bits and EXTRA bits.
        let distances = self.samples().map(|it| extended(it.distance));
        let sum = distances.fold(0i64, i64::saturating_add);
        let mean = |part: fn(&Parts) -> Micrometres| {
            let sum: f32 = self.samples().map(|it| part(&it.parts).to_f32()).sum();
            Micrometres::from_f32(sum / f32::from(count))
        };
        Mean {
            distance: sum / i64::from(count),
            noise_variance: squares / (f32::from(count) * f32::from(count)),
            parts: Parts {
                noise: mean(|it| it.noise),
                shape: mean(|it| it.shape),
                pixels: mean(|it| it.pixels),
                calibration: mean(|it| it.calibration),
                surface: mean(|it| it.surface),
                geometry: mean(|it| it.geometry),
                motion: mean(|it| it.motion),
            },
            misfits: self.samples().map(|it| it.misfits).max().unwrap_or(0),
            correlated: self.samples().filter_map(|it| it.correlated).min(),
        }
    }

    fn median(&self) -> Mean {
        let count = self.count();
        let mean = self.mean();
        let middle = [(count - 1) / 2, count / 2].map(|rank| extended(self.ranked(rank)));
        Mean {
            distance: (middle[0] + middle[1]) / 2,
            noise_variance: match count {
                1 | 2 => mean.noise_variance,
                _ => FRAC_PI_2 * mean.noise_variance,
            },
            ..mean
        }
    }

    /// The distance in the window that so many others are below.
    fn ranked(&self, rank: u8) -> Micrometres {
        let mut keys = [0; LONGEST as usize];
        for (key, sample) in keys.iter_mut().zip(self.samples()) {
            *key = ordered(sample.distance.to_bits());
        }
        let keys = keys.get(..self.count().into()).unwrap_or_default();
        let key = ranked(rank.into(), keys);
        key.map_or(Micrometres::default(), |key| {
            Micrometres::from_bits(from_ordered(key))
        })
    }

    fn recursive_mean(&mut self, reading: &Reading, length: u8) -> Mean {
        let (distance, noise) = (extended(reading.distance), reading.parts.noise.to_f32());
        let before = self.recursive.unwrap_or_default();
        let window = self.mean();
        let in_window = Some(window.misfits).filter(|&misfits| misfits > 0);
        let count = before.count.saturating_add(1).clamp(1, length.max(1));
        let weight = 1.0 / f32::from(count);
        let is_set = reading.correlated.is_some();
        let (kept, new) = ((1.0 - weight) * (1.0 - weight), weight * weight);
        let recursive = Recursive {
            // The difference has 32 bits and EXTRA bits.
            distance: (before.distance)
                .saturating_add(distance.saturating_sub(before.distance) / i64::from(count)),
            noise_variance: kept * before.noise_variance + new * noise * noise,
            count,
            misfits: (before.misfits).after(reading.misfits > 0, weight, in_window, u16::max),
            correlated: (before.correlated).after(is_set, weight, window.correlated, u16::min),
        };
        self.recursive = Some(recursive);
        Mean {
            distance: recursive.distance,
            noise_variance: recursive.noise_variance,
            misfits: recursive.misfits.worst.unwrap_or(0),
            correlated: recursive.correlated.worst,
            ..window
        }
    }

    /// The filter's reading: centre, height and rows are those of the latest reading.
    fn reading(&self, mean: &Mean, is_ambient_subtracted: bool, latest: Reading) -> Reading {
        let shared = if is_ambient_subtracted { 2.0 } else { 1.0 };
        let noise = dual_mac::square_root(shared * mean.noise_variance);
        let noise = Micrometres::from_f32(noise).min(mean.parts.noise);
        let parts = Parts {
            noise: noise.max(Micrometres::from_bits(1)),
            ..mean.parts
        };
        let half = 1 << (EXTRA - 1);
        let bits = (mean.distance.saturating_add(half)) >> EXTRA;
        Reading {
            #[expect(clippy::cast_possible_truncation, reason = "a mean of i32s")]
            distance: Micrometres::from_bits(bits as i32),
            uncertainty: parts.combined(),
            parts,
            misfits: mean.misfits,
            correlated: mean.correlated,
            ..latest
        }
    }
}

/// The raw integer with [`EXTRA`] more bits.
fn extended(distance: Micrometres) -> i64 {
    i64::from(distance.to_bits()) * (1 << EXTRA)
}
