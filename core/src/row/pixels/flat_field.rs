//! Takes a map of the pixels: sums dark rows, then rows with even light, and computes an entry for each
//! pixel.
//!
//! The offset of a pixel is its mean dark count less the mean of all pixels. Its gain is the mean light of
//! its neighbourhood over its own light. So a light that is not quite even, or that falls towards the ends of
//! the sensor, does not go into the map. The price: responses that change slowly along the sensor do not go
//! into the map either. They stay, and [`PixelErrors`] counts them.

use core::fmt;

use crate::base::{Counts, numeric};
use crate::row::pixels::PixelErrors;
use crate::row::pixels::map::{
    Entry, GAIN_FRACTION, LARGEST_GAIN, LARGEST_OFFSET, MAX_MAP_PIXELS, MapSummary,
    OFFSET_FRACTION, PixelMap,
};
use crate::row::pixels::scatter::Scatter;
use crate::row::{Geometry, LARGEST_COUNT, Row};

/// Rows of each kind. Their noise is what limits a map: 256 rows of 2000 counts leave 0.05 %. They last 1.5
/// s.
pub const ROWS: u16 = 256;
/// Half of the neighbourhood of a pixel, in pixels. At the ends of the sensor, it is as far as the end.
///
/// The mean over the neighbourhood has a noise of its own, which differs little between the two sides of a
/// spot: [`SLOW`].
const HALF_NEIGHBOURHOOD: usize = 512;
const SHORTEST_HALF: usize = 8;
/// The share of the responses that is so slow that it stays, as a spot of 10 pixels' width sees it.
///
/// A response of pixel i that differs by d_i moves the centre of a gaussian fit by the sum of a_i d_i, with
/// a = 2 u exp(-u^2) / sqrt(pi) and u = (x - c) / sigma. For d that is independent from pixel to pixel, that
/// is 0.632 sqrt(sigma) standard deviations. For the mean of such d over n pixels it is 0.893 sigma^1.5 / n.
/// The ratio of the two is 1.41 sigma / n.
const SLOW: f32 = 1.41 * 10.0 / (2 * HALF_NEIGHBOURHOOD + 1) as f32;
/// Full scale divided by this is the least mean light of lit rows. Each neighbourhood needs half of it.
const LEAST_LIGHT_DIVISOR: u16 = 10;
/// Full scale divided by this is how much brighter dark rows may be than the shielded pixels.
const LARGEST_DARK_DIVISOR: u16 = 20;
/// Pixels that are compared with their neighbourhood together, where light that is not even is looked for.
const BLOCK: usize = 8;
/// By how much a block may be brighter or darker than its neighbourhood, in shares of the light. Eight pixels
/// whose response has a standard deviation of 2.8 % have a mean with 1 %.
const LARGEST_UNEVENNESS: f32 = 0.06;
/// A pixel counts as no further from its neighbourhood than this, so that a bad pixel does not look like
/// light that is not even.
const LARGEST_SHARE: f32 = 0.2;
/// By how many counts a block of the dark row may be brighter than the mean of all pixels.
const LARGEST_SPOT: i32 = 32;
/// A pixel counts as no brighter than this in a dark row, in counts, so that a hot pixel does not look like a
/// spot.
const LARGEST_HOT: i32 = 100;
/// The most pixels that may be saturated in a row of even light.
const MOST_SATURATED: usize = 16;

/// Which rows are taken: dark or lit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// No light.
    Dark,
    /// Even light.
    Lit,
}

/// Rows that were taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Taken {
    /// The mean count of the light pixels.
    pub mean: Counts,
    /// What the map says of the sensor. `None` after the dark rows, which do not make a map yet.
    pub map: Option<MapSummary>,
}

/// Why rows do not make a map. `Display` gives the reason and what to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TakeError {
    /// No row came, or not a row of this sensor.
    Silent,
    /// The sensor has no light pixels, or more than a map holds.
    Pixels {
        /// How many it has.
        pixels: usize,
    },
    /// Lit rows were taken before dark rows.
    NoDark,
    /// The light pixels of the dark rows are brighter than the shielded pixels.
    NotDark {
        /// The mean count of the light pixels.
        light: Counts,
        /// The mean count of the shielded pixels.
        shielded: Counts,
    },
    /// A part of the dark rows is brighter than the rest.
    SpotInTheDark {
        /// The first pixel of the part.
        pixel: u16,
        /// By how many counts.
        above: i16,
    },
    /// Pixels are saturated in the lit rows.
    Saturated {
        /// How many in one row.
        pixels: u16,
    },
    /// The lit rows are not brighter than the dark rows.
    DarkIsBrighter {
        /// The mean of the lit rows.
        lit: Counts,
        /// The mean of the dark rows.
        dark: Counts,
    },
    /// The lit rows have too little light.
    TooDim {
        /// The light above the dark rows.
        light: Counts,
        /// The light that is needed.
        needed: Counts,
    },
    /// A part of the sensor has too little light.
    TooDimAt {
        /// The pixel.
        pixel: u16,
        /// The light of its neighbourhood above the dark rows.
        light: Counts,
        /// The light that is needed.
        needed: Counts,
    },
    /// A part of the lit rows is brighter or darker than its neighbourhood: a spot, a shadow or dirt.
    Uneven {
        /// The first pixel of the part.
        pixel: u16,
        /// By how many per cent of the light.
        percent: i16,
    },
}

impl fmt::Display for TakeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silent => f.write_str("the sensor gave no rows: check its cable, then try again"),
            Self::Pixels { pixels } => write!(
                f,
                "the sensor has {pixels} pixels, a map holds 1 to {MAX_MAP_PIXELS}: this sensor needs \
                 another firmware"
            ),
            Self::NoDark => {
                f.write_str("there are no dark rows: darken the sensor, then flat dark")
            }
            Self::NotDark { light, shielded } => write!(
                f,
                "the dark rows have {light} counts, the shielded pixels {shielded}: cover the sensor, switch \
                 the laser off"
            ),
            Self::SpotInTheDark { pixel, above } => write!(
                f,
                "the dark rows are {above} counts brighter at pixel {pixel}: cover the sensor, switch the \
                 laser off"
            ),
            Self::Saturated { pixels } => {
                write!(f, "{pixels} pixels are saturated: use less light")
            }
            Self::DarkIsBrighter { lit, dark } => write!(
                f,
                "the lit rows have {lit} counts, the dark rows {dark}: flat dark in the dark, then flat lit \
                 in the light"
            ),
            Self::TooDim { light, needed } => {
                write!(
                    f,
                    "{light} counts of light, {needed} needed: use more light"
                )
            }
            Self::TooDimAt {
                pixel,
                light,
                needed,
            } => write!(
                f,
                "{light} counts of light at pixel {pixel}, {needed} needed: light all of the sensor"
            ),
            Self::Uneven { pixel, percent } => write!(
                f,
                "the light at pixel {pixel} differs by {percent} % from its surroundings: laser off, slit \
                 removed, sensor clean"
            ),
        }
    }
}

impl core::error::Error for TakeError {}

/// The dark rows, as far as the lit rows need them.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Dark {
    pixels: u16,
    /// The mean count of all pixels, Q12.4.
    mean_q4: i32,
    /// The variance of an offset by the noise of the rows, in counts squared.
    variance: f32,
    /// Pixels whose offset is beyond what an entry holds.
    outside: u16,
    pattern: Counts,
}

/// A map, and the sums of the rows from which a new one is made. 26 KB: keep it in static memory.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatField {
    /// Becomes whole when lit rows were taken.
    map: PixelMap,
    sums: [Sum; MAX_MAP_PIXELS],
    shielded_sum: u32,
    shielded_pixels: u32,
    pixels: usize,
    rows: u16,
    kind: Kind,
    scatter: Scatter,
    dark: Option<Dark>,
}

impl FlatField {
    /// Without a map and without rows. All bytes are zero.
    pub const fn new() -> Self {
        Self {
            map: PixelMap::EMPTY,
            sums: [Sum::ZERO; MAX_MAP_PIXELS],
            shielded_sum: 0,
            shielded_pixels: 0,
            pixels: 0,
            rows: 0,
            kind: Kind::Dark,
            scatter: Scatter::NONE,
            dark: None,
        }
    }

    /// The map, if there is one.
    pub fn map(&self) -> Option<&PixelMap> {
        self.map.is_whole().then_some(&self.map)
    }

    /// The place of the map, for a map that was kept. Forgets the dark rows, whose offsets are there.
    pub fn place(&mut self) -> &mut PixelMap {
        self.dark = None;
        &mut self.map
    }

    /// Begins to take rows. The map stays in use until the last dark row is taken.
    ///
    /// # Errors
    /// The sensor has too many pixels, or there are no dark rows yet.
    pub fn begin(&mut self, kind: Kind, geometry: &Geometry) -> Result<(), TakeError> {
        let pixels = geometry.light.len();
        if pixels == 0 || pixels > MAX_MAP_PIXELS {
            return Err(TakeError::Pixels { pixels });
        }
        let is_of_this = |dark: &Dark| usize::from(dark.pixels) == pixels;
        if kind == Kind::Lit && !self.dark.as_ref().is_some_and(is_of_this) {
            return Err(TakeError::NoDark);
        }
        self.sums.fill(Sum::ZERO);
        self.shielded_sum = 0;
        self.shielded_pixels = 0;
        self.pixels = pixels;
        self.rows = 0;
        self.kind = kind;
        self.scatter = Scatter::NONE;
        Ok(())
    }

    /// Adds the words of a row. Where words fall with light, subtracts them from full scale in place. Returns
    /// the result after [`ROWS`] rows.
    pub fn add(
        &mut self,
        words: &mut [u16],
        geometry: &Geometry,
    ) -> Option<Result<Taken, TakeError>> {
        let Ok(row) = geometry.row(words) else {
            return Some(Err(TakeError::Silent));
        };
        if let Err(error) = self.add_row(&row) {
            return Some(Err(error));
        }
        if self.rows < ROWS {
            return None;
        }
        Some(match self.kind {
            Kind::Dark => self.finish_dark(geometry.full_scale()),
            Kind::Lit => self.finish_lit(geometry.full_scale()),
        })
    }

    fn add_row(&mut self, row: &Row<'_>) -> Result<(), TakeError> {
        let light = row.light();
        if light.len() != self.pixels || self.rows >= ROWS {
            return Err(TakeError::Silent);
        }
        if self.kind == Kind::Lit {
            let saturation = row.saturated_from();
            let pixels = numeric::count(light.iter().map(|count| count >= saturation));
            if pixels > MOST_SATURATED {
                let pixels = numeric::to_u16(pixels);
                return Err(TakeError::Saturated { pixels });
            }
        }
        for (sum, count) in self.sums.iter_mut().zip(light.iter()) {
            sum.add(count);
        }
        for count in row.shielded().iter() {
            self.shielded_sum = self.shielded_sum.saturating_add(count.into());
            self.shielded_pixels = self.shielded_pixels.saturating_add(1);
        }
        self.scatter.add(light);
        self.rows = self.rows.saturating_add(1);
        Ok(())
    }

    fn light_sums(&self) -> &[Sum] {
        self.sums.get(..self.pixels).unwrap_or_default()
    }

    /// The mean count of all light pixels, Q12.4.
    fn mean_q4(&self) -> i32 {
        // Below 2^12 pixels of 2^20: 2^32, and 2^36 in Q4. A pixel's mean is below 2^12.
        let sum = (self.light_sums().iter())
            .fold(0, |sum, of_one| numeric::add_u64(sum, of_one.get().into()));
        let counts = (self.pixels as u64).saturating_mul(self.rows.into());
        let mean = sum.saturating_mul(1 << OFFSET_FRACTION).checked_div(counts);
        numeric::i64_to_i32(mean.unwrap_or_default().cast_signed())
    }

    fn finish_dark(&mut self, full_scale: u16) -> Result<Taken, TakeError> {
        let mean_q4 = self.mean_q4();
        let light = from_q4(mean_q4);
        let shielded = (u64::from(self.shielded_sum) * (1 << Counts::FRACTION))
            .checked_div(self.shielded_pixels.into());
        if let Some(shielded) = shielded {
            let shielded = Counts::from_bits(numeric::i64_to_i32(shielded.cast_signed()));
            let limit = Counts::from_int(i32::from(full_scale / LARGEST_DARK_DIVISOR));
            if light.to_bits().saturating_sub(shielded.to_bits()) > limit.to_bits() {
                return Err(TakeError::NotDark { light, shielded });
            }
        }
        let rows = i32::from(self.rows.max(1));
        // The offset of a pixel, Q4. A sum is at most 2^20, so everything is below 2^25.
        let offset = |sum: u32| {
            let sum_q4 = (sum.min(MOST_SUM) as i32) * (1 << OFFSET_FRACTION);
            (sum_q4 + rows / 2).checked_div(rows).unwrap_or_default()
        };
        let offset = |sum: u32| offset(sum).saturating_sub(mean_q4);
        let mut pixel = 0u16;
        for sums in self.light_sums().chunks(BLOCK) {
            const HOT: i32 = LARGEST_HOT << OFFSET_FRACTION;
            let above = sums.iter().fold(0i32, |all, sum| {
                all.saturating_add(offset(sum.get()).clamp(-HOT, HOT))
            });
            let above = (above / numeric::to_i32(BLOCK)) >> OFFSET_FRACTION;
            if above > LARGEST_SPOT {
                return Err(TakeError::SpotInTheDark {
                    pixel,
                    above: i16::try_from(above).unwrap_or(i16::MAX),
                });
            }
            pixel = pixel.saturating_add(numeric::to_u16(BLOCK));
        }
        // The map's offsets change from here on.
        self.map.clear();
        let (mut outside, mut steps, mut before) = (0u16, 0u64, 0i32);
        let sums = self.sums.get(..self.pixels).unwrap_or_default();
        for (entry, sum) in self.map.entries.iter_mut().zip(sums) {
            let offset = offset(sum.get());
            const LARGEST: i32 = LARGEST_OFFSET as i32;
            let held = offset.clamp(-LARGEST, LARGEST);
            outside = outside.saturating_add(u16::from(held != offset));
            // Below 2^15 each, 2^12 of them.
            steps = numeric::add_u64(steps, held.abs_diff(before).into());
            before = held;
            let held = i16::try_from(held).unwrap_or_default();
            *entry = Entry::new(held, 0).unwrap_or_default();
        }
        let variance = variance_of_mean(self.scatter.variance(), self.rows);
        const ROUNDING: f32 = 1.0 / (12 << (2 * OFFSET_FRACTION)) as f32;
        // sqrt(pi)/2 times the mean step between neighbours, as the search estimates the noise of a row.
        let pattern =
            0.886 * steps as f32 / (self.pixels.max(1) as f32 * (1 << OFFSET_FRACTION) as f32);
        self.dark = Some(Dark {
            pixels: numeric::to_u16(self.pixels),
            mean_q4,
            variance: variance + ROUNDING,
            outside,
            pattern: Counts::from_f32(pattern),
        });
        Ok(Taken {
            mean: light,
            map: None,
        })
    }

    fn finish_lit(&mut self, full_scale: u16) -> Result<Taken, TakeError> {
        let dark = self.dark.ok_or(TakeError::NoDark)?;
        let (lit_q4, dark_q4) = (self.mean_q4(), dark.mean_q4);
        let (lit, needed) = (from_q4(lit_q4), least_light(full_scale, 1));
        if lit_q4 <= dark_q4 {
            return Err(TakeError::DarkIsBrighter {
                lit,
                dark: from_q4(dark_q4),
            });
        }
        let light = from_q4(lit_q4.saturating_sub(dark_q4));
        if light < needed {
            return Err(TakeError::TooDim { light, needed });
        }
        let Gains { squares, outside } = self.compute_gains(dark_q4, least_light(full_scale, 2))?;
        let pixels = self.pixels.max(1) as f32;
        let mean = light.to_f32();
        let noise = variance_of_mean(self.scatter.variance(), self.rows) + dark.variance;
        const STEP: f32 = 1.0 / (1u32 << GAIN_FRACTION) as f32;
        let response =
            noise / (mean * mean) + STEP * STEP / 12.0 + SLOW * SLOW * (squares / pixels);
        let summary = MapSummary {
            errors: PixelErrors {
                // Never zero: no map is perfect.
                response_q16: numeric::whole_u16(dual_mac::square_root(response) * 65536.0 + 0.5)
                    .max(1),
                offset: Counts::from_f32(dual_mac::square_root(dark.variance))
                    .max(Counts::from_bits(1)),
            },
            pattern: dark.pattern,
            outside: dark.outside.saturating_add(outside),
        };
        self.map.summary = summary;
        self.map.pixels = numeric::to_u16(self.pixels);
        Ok(Taken {
            mean: lit,
            map: Some(summary),
        })
    }

    /// Writes the gains into the map's entries. The map must not be whole.
    fn compute_gains(&mut self, dark_q4: i32, least: Counts) -> Result<Gains, TakeError> {
        self.map.clear();
        let pixels = self.pixels;
        let sums = self.sums.get(..pixels).unwrap_or_default();
        let rows = i32::from(self.rows.max(1));
        // The light of a pixel, the sum of all rows, Q4. Below 2^24 less 2^8 times 2^17.
        let light_of = |sum: u32, entry: &Entry| {
            let dark = dark_q4.saturating_add(entry.offset_q4().into());
            ((sum.min(MOST_SUM) as i32) * (1 << OFFSET_FRACTION))
                .saturating_sub(dark.saturating_mul(rows))
        };
        let per_row = 1.0 / (rows as f32 * (1 << OFFSET_FRACTION) as f32);
        let mut gains = Gains {
            squares: 0.0,
            outside: 0,
        };
        let (mut begin, mut end, mut around) = (0usize, 0usize, 0i64);
        let mut block = 0.0f32;
        for at in 0..pixels {
            let left = at.min(pixels.saturating_sub(1).saturating_sub(at));
            let half = left.clamp(SHORTEST_HALF, HALF_NEIGHBOURHOOD);
            let first = at.saturating_sub(half);
            let last = at.saturating_add(half).saturating_add(1).min(pixels);
            // Both ends only move to the right, so each pixel enters once and leaves once.
            while end < last {
                around = around.saturating_add(light(sums, &self.map.entries, end, light_of));
                end = end.saturating_add(1);
            }
            while begin < first {
                around = around.saturating_sub(light(sums, &self.map.entries, begin, light_of));
                begin = begin.saturating_add(1);
            }
            let mean = around as f32 / (end.saturating_sub(begin)).max(1) as f32;
            let at_least = mean * per_row;
            if at_least < least.to_f32() {
                return Err(TakeError::TooDimAt {
                    pixel: numeric::to_u16(at),
                    light: Counts::from_f32(at_least),
                    needed: least,
                });
            }
            let own = light(sums, &self.map.entries, at, light_of) as f32;
            block += numeric::limited(own / mean - 1.0, -LARGEST_SHARE, LARGEST_SHARE);
            if at % BLOCK == BLOCK - 1 {
                let share = block / BLOCK as f32;
                if share > LARGEST_UNEVENNESS || share < -LARGEST_UNEVENNESS {
                    return Err(TakeError::Uneven {
                        pixel: numeric::to_u16(at - (BLOCK - 1)),
                        #[expect(clippy::cast_possible_truncation, reason = "`as` saturates")]
                        percent: (share * 100.0) as i16,
                    });
                }
                block = 0.0;
            }
            // No light at all becomes the largest gain.
            let gain = mean / own.max(1.0) - 1.0;
            let scaled = gain * (1u32 << GAIN_FRACTION) as f32;
            let held = numeric::limited(scaled, -f32::from(LARGEST_GAIN), LARGEST_GAIN.into());
            if held == scaled {
                gains.squares += gain * gain;
            } else {
                gains.outside = gains.outside.saturating_add(1);
            }
            #[expect(clippy::cast_possible_truncation, reason = "limited to an i16")]
            let rounded = (held + 0.5f32.copysign(held)) as i16;
            if let Some(entry) = self.map.entries.get_mut(at) {
                *entry = Entry::new(entry.offset_q4(), rounded).unwrap_or_default();
            }
        }
        Ok(gains)
    }
}

impl Default for FlatField {
    fn default() -> Self {
        Self::new()
    }
}

struct Gains {
    /// The sum of the squares of those that an entry holds.
    squares: f32,
    /// How many pixels have a gain that no entry holds.
    outside: u16,
}

const MOST_SUM: u32 = ROWS as u32 * LARGEST_COUNT as u32;

// In Q4, a sum is exact and far below 2^31.
const _: () = assert!(MOST_SUM << OFFSET_FRACTION < 1 << 24);

/// The counts of a pixel in up to [`ROWS`] rows, in 24 bits: there is one for each pixel, so 32 bits would
/// take 3.6 KB more of RAM.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sum([u8; 3]);

impl Sum {
    const ZERO: Self = Self([0; 3]);

    const fn get(self) -> u32 {
        let Self([low, middle, high]) = self;
        u32::from_le_bytes([low, middle, high, 0])
    }

    fn add(&mut self, count: u16) {
        let [low, middle, high, _] = numeric::add_u32(self.get(), count.into()).to_le_bytes();
        *self = Self([low, middle, high]);
    }
}

fn light(sums: &[Sum], entries: &[Entry], at: usize, light_of: impl Fn(u32, &Entry) -> i32) -> i64 {
    match (sums.get(at), entries.get(at)) {
        (Some(sum), Some(entry)) => light_of(sum.get(), entry).into(),
        _ => 0,
    }
}

/// The least light: a tenth of full scale, divided by a number.
fn least_light(full_scale: u16, divided_by: u16) -> Counts {
    let bits = i32::from(full_scale) * (1 << Counts::FRACTION) / i32::from(LEAST_LIGHT_DIVISOR);
    Counts::from_bits(bits.checked_div(divided_by.into()).unwrap_or(bits))
}

fn from_q4(count: i32) -> Counts {
    Counts::from_bits(count.saturating_mul(1 << (Counts::FRACTION - OFFSET_FRACTION)))
}

/// The variance of the mean of rows. Rows whose noise is far below a count all round the same way, so their
/// mean is no better than a row.
fn variance_of_mean(of_a_row: f32, rows: u16) -> f32 {
    /// The variance of rounding to a count.
    const ROUNDING: f32 = 1.0 / 12.0;
    /// Noise above this variance spreads the rounding.
    const SPREADS: f32 = 0.25;
    let mean = of_a_row / f32::from(rows.max(1));
    if of_a_row < SPREADS {
        mean + ROUNDING
    } else {
        mean
    }
}
