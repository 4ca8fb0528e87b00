//! What can be wrong with a row: each flaw a small change of its counts.
//!
//! Where a scene has the effect (`simulator::scene`), the flaw is that effect.

use crate::hard_cases::recipe::Site;
use crate::hard_cases::truth::Truth;
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use simulator::scene::{Ambient, Flare, Quantisation, Saturation, SecondReflection, random};
use std::f64::consts::TAU;
use std::fmt;

/// When a flaw comes about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// It is light, or like light: it has shot noise and fills the well.
    Light,
    /// It is charge in the pixels, after the light's noise.
    Charge,
    /// It is on the way to the converter, black level and read noise included.
    Volts,
    /// It is done to the converter's words.
    Words,
}

/// One thing that is wrong with a row. Lengths are in widths of the spot or in pixels, as said; heights in
/// shares of the spot's or in counts, as said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Flaw {
    /// A second spot.
    Second(Second),
    /// A wide ghost of the spot.
    Ghost(Second),
    /// A background that rises along the row, in counts a pixel.
    Slope(f64),
    /// A lamp that lights one end of the row: counts at that end, falling to 1/e over a quarter of the row.
    Glow(f64),
    /// Pixels that leak: counts, how many side by side, and how far from the spot (widths).
    Hot(Bad),
    /// Pixels that see nothing.
    Dead(Bad),
    /// Pixels that always read the same: so many counts.
    Stuck(Bad),
    /// Pixels differ in what they make of light by this standard deviation (share).
    Response(f64),
    /// A pixel holds no more than so many counts; the share of what is beyond that flows over to both sides.
    FullWell(f64, f64),
    /// Excess drags behind the spot to its right: this share of each pixel's overflow goes to the next.
    Smear(f64),
    /// Unlit pixels differ by this standard deviation in counts.
    FixedPattern(f64),
    /// The black level changes by so many counts so many widths from the spot, for the rest of the row.
    Step(f64, f64),
    /// The black level bends along the row: a half wave of so many counts.
    Sag(f64),
    /// A sine on the black level: its height in counts and its period in pixels, at a random phase.
    Ripple(f64, f64),
    /// Every other pixel reads so many counts more.
    OddEven(f64),
    /// This share of the pixels reads anything from 0 to 4095.
    Impulses(f64),
    /// The converter has steps of so many counts.
    Steps(f64),
    /// A bit of the converter's words never changes: which (0 is the least), and whether it is set.
    StuckBit(u8, bool),
}

/// A second spot, as a shiny surface or a lens makes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Second {
    /// Height over the spot's.
    pub share: f64,
    /// From the spot's centre to its own, in widths of the spot.
    pub offset: f64,
    /// Its width in widths of the spot.
    pub widths: f64,
}

/// Bad pixels side by side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bad {
    /// Counts that they have.
    pub counts: f64,
    /// How many.
    pub pixels: usize,
    /// The first is between so many widths from the spot, on a side that the row's number draws.
    pub from_spot: (f64, f64),
}

impl fmt::Display for Flaw {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |share: &f64| format!("{:.1} %", 100.0 * share);
        let text = match self {
            Self::Second(second) => format!("a second spot of {second}"),
            Self::Ghost(ghost) => format!("a ghost of {ghost}"),
            Self::Slope(counts) => format!("the background rises by {counts:.3} counts a pixel"),
            Self::Glow(counts) => format!("a lamp lights one end by {counts:.1} counts"),
            Self::Hot(bad) => format!("hot pixels: {bad}"),
            Self::Dead(bad) => format!("dead pixels: {bad}"),
            Self::Stuck(bad) => format!("stuck pixels: {bad}"),
            Self::Response(share) => format!("pixels differ in response by {}", percent(share)),
            Self::FullWell(counts, blooming) => {
                let rest = percent(blooming);
                format!(
                    "a pixel holds {counts:.1} counts, and {rest} of the rest flows over to both sides"
                )
            }
            Self::Smear(share) => {
                let share = percent(share);
                format!("{share} of what is beyond full scale flows to the next pixel")
            }
            Self::FixedPattern(counts) => format!("unlit pixels differ by {counts:.2} counts"),
            Self::Step(counts, offset) => {
                format!("the black level steps by {counts:+.1} counts, {offset:+.2} widths off")
            }
            Self::Sag(counts) => format!("the black level bends by {counts:+.1} counts"),
            Self::Ripple(counts, period) => {
                format!("a ripple of {counts:.1} counts with a period of {period:.2} pixels")
            }
            Self::OddEven(counts) => format!("every other pixel reads {counts:+.1} counts more"),
            Self::Impulses(share) => format!("{} of the pixels read anything", percent(share)),
            Self::Steps(counts) => format!("the converter has steps of {counts} counts"),
            Self::StuckBit(bit, high) => {
                let high = u8::from(*high);
                format!("bit {bit} of the converter is always {high}")
            }
        };
        f.write_str(&text)
    }
}

impl fmt::Display for Second {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (percent, widths, offset) = (100.0 * self.share, self.widths, self.offset);
        write!(
            f,
            "{percent:.1} % of the height and {widths:.2} times the width, {offset:+.2} widths off"
        )
    }
}

impl fmt::Display for Bad {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (counts, pixels, (near, far)) = (self.counts, self.pixels, self.from_spot);
        write!(
            f,
            "{pixels} side by side of {counts:.1} counts, {near:.2} to {far:.2} widths from the spot"
        )
    }
}

impl Second {
    /// One of this height, at this distance, and so wide, each over the spot's.
    pub const fn new(share: f64, offset: f64, widths: f64) -> Self {
        Self {
            share,
            offset,
            widths,
        }
    }

    /// Of two spots the higher is the laser's where it is higher by a quarter or more, as far as both are on
    /// the row: a reflection is dimmer than what it reflects. Where they are more alike nobody can tell.
    /// Where their light has one peak it is one spot that is not symmetric, and its centre is anywhere from
    /// that of the higher to the centroid of both.
    pub fn truth(&self, truth: Truth, centre: f64, width: f64, pixels: usize) -> Truth {
        let other = centre + self.offset * width;
        let seen = |centre: f64, width: f64| {
            let beyond = (centre - centre.clamp(0.0, pixels as f64 - 1.0)) / width;
            (-0.5 * beyond * beyond).exp()
        };
        let share = self.share * seen(other, self.widths * width) / seen(centre, width);
        let second_is_higher = share >= LIKE;
        let alike = !second_is_higher && share >= 1.0 / LIKE;
        if self.has_two_peaks() {
            return match (alike, second_is_higher) {
                (true, _) => Truth::None,
                (_, true) => Truth::Centre(other),
                (_, false) => truth,
            };
        }
        let light = self.share * self.widths;
        let centroid = centre + self.offset * width * light / (1.0 + light);
        match (alike, second_is_higher) {
            (true, _) => truth.reaching(other),
            (_, true) => Truth::Centre(other).reaching(centroid),
            (_, false) => truth.reaching(centroid),
        }
    }

    /// Whether the sum of both has two maxima: a dip between the centres.
    fn has_two_peaks(&self) -> bool {
        const STEPS: usize = 200;
        let sum = |step: usize| {
            // A little beyond both centres, where the sum falls.
            let x = self.offset * (1.2 * step as f64 / STEPS as f64 - 0.1);
            let u = (x - self.offset) / self.widths;
            (-0.5 * x * x).exp() + self.share * (-0.5 * u * u).exp()
        };
        let rises: Vec<bool> = (0..STEPS).map(|i| sum(i + 1) > sum(i)).collect();
        let tops = rises.windows(2).filter(|pair| pair[0] && !pair[1]).count();
        tops > 1
    }
}

/// Spots whose heights differ by less than this factor are alike.
pub const LIKE: f64 = 1.25;

impl Flaw {
    /// When it comes about.
    pub const fn stage(&self) -> Stage {
        match self {
            Self::Second(_)
            | Self::Ghost(_)
            | Self::Slope(_)
            | Self::Glow(_)
            | Self::Hot(_)
            | Self::Response(_) => Stage::Light,
            Self::FullWell(..) | Self::Smear(_) => Stage::Charge,
            Self::FixedPattern(_)
            | Self::Step(..)
            | Self::Sag(_)
            | Self::Ripple(..)
            | Self::OddEven(_)
            | Self::Impulses(_)
            | Self::Dead(_)
            | Self::Stuck(_)
            | Self::Steps(_) => Stage::Volts,
            Self::StuckBit(..) => Stage::Words,
        }
    }

    /// Counts of light that a pixel holds: infinitely many, where the flaw does not limit them.
    pub const fn full_well(&self) -> f64 {
        match self {
            Self::FullWell(counts, _) => *counts,
            Self::Smear(_) => FULL_WELL,
            _ => f64::INFINITY,
        }
    }

    /// Does it to a row's counts.
    pub fn apply(&self, counts: &mut [f32], site: &Site, random: &mut ChaCha8Rng) {
        let last = counts.len() as f64 - 1.0;
        match *self {
            // Without a spot there is nothing to be reflected.
            Self::Second(_) | Self::Ghost(_) if site.spot.is_none() => {}
            Self::Second(second) => SecondReflection {
                offset: second.offset * site.width(),
                width: second.widths * site.width(),
                strength: second.share,
            }
            .add(counts, site.middle(), site.amplitude()),
            Self::Ghost(ghost) => {
                // The ghost is as far from the axis as the spot.
                let axis = site.middle() + 0.5 * ghost.offset * site.width();
                let ghost = Flare {
                    magnification: 1.0,
                    width: ghost.widths * site.width(),
                    strength: ghost.share,
                    veil: 0.0,
                };
                ghost.add(counts, 0.0, site.middle(), axis, site.amplitude());
            }
            Self::Slope(slope) => Ambient {
                // None at the darker end.
                counts_per_second: 0.5 * slope.abs() * last,
                slope,
            }
            .add(counts, 1.0),
            Self::Glow(height) => add(counts, |i| height * (-4.0 * i / last).exp()),
            Self::Hot(bad) => add(bad.of(counts, site, random), |_| bad.counts),
            Self::Dead(bad) | Self::Stuck(bad) => {
                bad.of(counts, site, random).fill(bad.counts as f32);
            }
            Self::Response(deviation) => {
                let normals = random::normals_of(random, counts.len());
                for (count, normal) in counts.iter_mut().zip(normals) {
                    *count *= (1.0 + deviation as f32 * normal).max(0.0);
                }
            }
            Self::FullWell(full_well, blooming) => Saturation {
                full_well,
                blooming,
            }
            .apply(counts),
            Self::Smear(share) => {
                let full = FULL_WELL as f32;
                let mut carried = 0.0;
                for count in counts {
                    *count += carried;
                    carried = share as f32 * (*count - full).max(0.0);
                    *count = count.min(full);
                }
            }
            Self::FixedPattern(deviation) => {
                let normals = random::normals_of(random, counts.len());
                for (count, normal) in counts.iter_mut().zip(normals) {
                    *count += deviation as f32 * normal;
                }
            }
            Self::Step(height, offset) => {
                let from = (site.middle() + offset * site.width()).clamp(0.0, last) as usize;
                add(&mut counts[from..], |_| height);
            }
            Self::Sag(height) => add(counts, |i| height * (0.5 * TAU * i / last).sin()),
            Self::Ripple(height, period) => {
                let phase = TAU * random.random::<f64>();
                add(counts, |i| height * (TAU * i / period + phase).sin());
            }
            Self::OddEven(height) => {
                let odd = counts.iter_mut().skip(1).step_by(2);
                odd.for_each(|count| *count += height as f32);
            }
            Self::Impulses(share) => {
                for count in counts {
                    if random.random::<f64>() < share {
                        *count = random.random_range(0.0..4095.0);
                    }
                }
            }
            Self::Steps(step) => {
                Quantisation { step }.apply(counts, slitrange::row::LARGEST_COUNT);
            }
            Self::StuckBit(..) => {}
        }
    }

    /// Does to the converter's words what is done there.
    pub fn to_words(&self, words: &mut [u16]) {
        if let Self::StuckBit(bit, high) = *self {
            let mask = 1 << bit;
            for word in words {
                *word = if high { *word | mask } else { *word & !mask };
            }
        }
    }
}

/// Adds to each pixel what a function gives for its number.
fn add(counts: &mut [f32], added: impl Fn(f64) -> f64) {
    for (i, count) in counts.iter_mut().enumerate() {
        *count += added(i as f64) as f32;
    }
}

/// Counts of light that fill a pixel which smears.
const FULL_WELL: f64 = 3600.0;

impl Bad {
    /// The bad ones among the counts.
    fn of<'a>(&self, counts: &'a mut [f32], site: &Site, random: &mut ChaCha8Rng) -> &'a mut [f32] {
        let from = site.pixel(self.from_spot, random);
        let to = (from + self.pixels).min(counts.len());
        &mut counts[from..to]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two equal gaussians have two peaks where they are more than two sigma apart.
    #[test]
    fn the_higher_spot_counts_unless_two_spots_are_similar_or_have_one_peak() {
        let truth = |share, offset| {
            Second::new(share, offset, 1.0).truth(Truth::Centre(100.0), 100.0, 10.0, 512)
        };
        assert_eq!(truth(0.5, 5.0), Truth::Centre(100.0));
        assert_eq!(truth(1.0, 5.0), Truth::None);
        assert_eq!(truth(0.8, 5.0), Truth::None);
        assert_eq!(truth(1.3, 5.0), Truth::Centre(150.0));
        assert_eq!(truth(1.0, 2.1), Truth::None);
        assert_eq!(truth(1.0, 1.9), Truth::Between(100.0, 119.0));
        assert_eq!(truth(0.25, 1.5), Truth::Between(100.0, 103.0));
        // Off the row it is not seen.
        assert_eq!(truth(1.0, -15.0), Truth::Centre(100.0));
    }
}
