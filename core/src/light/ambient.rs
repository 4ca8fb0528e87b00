//! Ambient light: takes rows with the laser off, and subtracts their mean from the rows with the laser on.
//!
//! Subtraction removes what both kinds of rows share: sunlight, its slopes, the pattern of the pixels in the
//! dark, and the dark current. The subtracted rows have their background at the black level.
//!
//! The mean has noise of its own, and this noise is the same in all rows of a frame. So the mean is a long
//! one: it follows the light with a time constant of 128 rows with the laser off, 1.5 s.
//! [`AmbientMean::share`] says how much noise it has.

use crate::base::{Counts, named, numeric};
use crate::row::{Geometry, Light, MAX_PIXELS, Row};

/// What is done about ambient light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AmbientMode {
    /// Nothing: the estimators find the background around the spot.
    #[default]
    Off,
    /// Every second row has the laser off, and the mean of these rows is subtracted from the others.
    Subtract,
}

named! { AmbientMode { Off: "off", Subtract: "subtract" } }

/// The latest row counts in the mean with one in 2^7 = 128. A shorter mean follows the light faster, and has
/// more noise: a frame of 16 rows then has, of the background's noise, 16/255 more variance.
pub const LONGEST_LOG2: u32 = 7;
/// After so many rows, the mean is at its longest.
const LONGEST: u8 = 1 << LONGEST_LOG2;
/// Light that differs from the mean by more than this counts as other light, in counts. The mean over all
/// pixels of a row has a noise below one count.
const OTHER_LIGHT: u16 = 16;
/// After so many rows of other light in succession, all brighter than the mean or all darker, the mean begins
/// again. Under a lamp that flickers, at most four rows in succession are brighter than the mean: a row comes
/// every 11.4 ms, so the phase moves by 0.14 periods from row to row at 100 Hz, and by 0.37 at 120 Hz.
const ROWS_OF_OTHER_LIGHT: i8 = 8;
/// Bits after the binary point of a mean. Counts have 12 bits, so a mean fits 16.
const FRACTION: u32 = 4;
/// One count, in the steps of a mean.
const ONE: u16 = 1 << FRACTION;

/// The running mean of the rows with the laser off.
#[derive(Clone, Debug)]
pub struct AmbientMean {
    /// The mean of each light pixel.
    pixels: [u16; MAX_PIXELS],
    /// The number of light pixels.
    length: usize,
    /// The mean of all light pixels.
    level: u16,
    /// The mean of the shielded pixels, or of all light pixels if none is shielded.
    black: u16,
    /// Rows so far, at most [`LONGEST`].
    rows: u8,
    /// Rows of other light in succession: below zero if they were darker than the mean.
    other_light: i8,
    /// Counts all rows, and begins again at zero.
    turn: u8,
    share: f32,
}

impl AmbientMean {
    /// No row yet.
    pub const EMPTY: Self = Self {
        pixels: [0; MAX_PIXELS],
        length: 0,
        level: 0,
        black: 0,
        rows: 0,
        turn: 0,
        other_light: 0,
        share: 1.0,
    };

    /// Forgets all rows.
    pub fn clear(&mut self) {
        self.rows = 0;
        self.other_light = 0;
    }

    /// The variance of a pixel's mean over the variance of the pixel in one row. `None` if there is no row
    /// yet.
    pub fn share(&self) -> Option<f32> {
        (self.rows > 0).then_some(self.share)
    }

    /// Takes a row that was exposed with the laser off.
    pub fn take(&mut self, row: &Row<'_>) {
        let light = row.light();
        let level = mean(light);
        if self.is_other_light(level) || light.len() != self.length {
            self.clear();
        }
        let mut step = Step::after(self.rows, self.turn);
        let (words, inverted) = light.words();
        for_each_pair(&mut self.pixels, words, |mean, word| {
            *mean = step.towards(*mean, (word ^ inverted).saturating_mul(ONE));
        });
        let black = match row.shielded() {
            shielded if shielded.is_empty() => level,
            shielded => mean(shielded),
        };
        self.level = step.towards(self.level, level);
        self.black = step.towards(self.black, black);
        self.share = step.share(self.share);
        self.length = light.len();
        self.rows = self.rows.saturating_add(1).min(LONGEST);
        self.turn = self.turn.wrapping_add(1);
    }

    /// Whether the light has changed for good: see [`ROWS_OF_OTHER_LIGHT`].
    fn is_other_light(&mut self, level: u16) -> bool {
        let limit = OTHER_LIGHT.saturating_mul(ONE);
        self.other_light = if level > self.level.saturating_add(limit) {
            self.other_light.max(0).saturating_add(1)
        } else if level < self.level.saturating_sub(limit) {
            self.other_light.min(0).saturating_sub(1)
        } else {
            0
        };
        self.other_light.unsigned_abs() >= ROWS_OF_OTHER_LIGHT.unsigned_abs()
    }

    /// Subtracts the mean from the light pixels of a row with the laser on, in place. The background comes
    /// to lie at the black level. In a row that is darker than the mean it would lie below: the whole row is
    /// raised by what is missing, so that no count is cut off at zero.
    ///
    /// A saturated pixel stays as it is, and no other pixel becomes one. Does nothing without a row with the
    /// laser off, and with a row of another length.
    ///
    /// Returns by how much the background became lower. `None` if nothing was done.
    pub fn subtract(&self, words: &mut [u16], geometry: &Geometry) -> Option<Counts> {
        let light = geometry.row_of_valid(words)?.light();
        if self.rows == 0 || light.len() != self.length {
            return None;
        }
        let missing = self.level.saturating_sub(mean(light));
        let kept = i32::from(self.black) + i32::from(missing);
        let (saturation, inverted) = (geometry.saturated_from(), geometry.inverted());
        let highest = i32::from(saturation.saturating_sub(1));
        // Half a count, so that the shift rounds.
        let raised = kept + i32::from(ONE / 2);
        let words = words.get_mut(geometry.light.clone())?;
        for_each_pair(words, &self.pixels, |word, mean| {
            let count = *word ^ inverted;
            if count >= saturation {
                return;
            }
            // Each term is below 2^18.
            let above = i32::from(count) * i32::from(ONE) - i32::from(*mean);
            let rounded = numeric::add_i32(above, raised) >> FRACTION;
            *word = numeric::i32_to_u16(rounded.clamp(0, highest)) ^ inverted;
        });
        let lower = numeric::sub_i32(i32::from(self.level), kept).max(0);
        let bits = lower * (1 << (Counts::FRACTION - FRACTION));
        Some(Counts::from_bits(bits))
    }
}

/// Changes each number with the one at the same place of the other slice. Eight places in a turn of the loop:
/// a program that is linked for size would have one.
fn for_each_pair(changed: &mut [u16], other: &[u16], mut change: impl FnMut(&mut u16, &u16)) {
    let length = changed.len().min(other.len());
    let changed = changed.get_mut(..length).unwrap_or_default();
    let other = other.get(..length).unwrap_or_default();
    let (eights, rest) = changed.as_chunks_mut::<8>();
    let (other_eights, other_rest) = other.as_chunks::<8>();
    for (changed, other) in eights.iter_mut().zip(other_eights) {
        for (changed, other) in changed.iter_mut().zip(other) {
            change(changed, other);
        }
    }
    for (changed, other) in rest.iter_mut().zip(other_rest) {
        change(changed, other);
    }
}

/// The mean of some pixels, in the steps of a mean.
fn mean(light: Light<'_>) -> u16 {
    // At most 2^12 pixels of 12 bits: below 2^28 in all.
    let sum = light.sum().saturating_mul(ONE.into());
    let mean = sum.checked_div(numeric::to_u32(light.len()));
    u16::try_from(mean.unwrap_or_default()).unwrap_or(u16::MAX)
}

/// How far a row moves the means: by one part in 2^`log2` of the difference.
struct Step {
    log2: u32,
    /// What rounding left of the step of the pixel before, below 2^`log2`. The next pixel takes it, so that
    /// the pixels together follow a difference that is too small to move each of them. The noise of rounding
    /// then cancels between neighbours, and does not move a spot.
    rest: i32,
}

impl Step {
    /// The step after so many rows. The first row is the mean; then the parts get smaller. Each `turn` begins
    /// with another rest.
    fn after(rows: u8, turn: u8) -> Self {
        let log2 = rows.saturating_add(1).ilog2().min(LONGEST_LOG2);
        let below = 1u8.wrapping_shl(log2).wrapping_sub(1);
        // An odd factor takes the numbers below a power of two to all of them, in another order.
        let rest = (turn.wrapping_mul(41) & below).into();
        Self { log2, rest }
    }

    /// The mean after a value. It lies between the two, or is one of them.
    fn towards(&mut self, mean: u16, value: u16) -> u16 {
        let difference = numeric::sub_i32(value.into(), mean.into());
        let all = numeric::add_i32(difference, self.rest);
        let step = all.wrapping_shr(self.log2);
        // Exact: what the shift drops.
        self.rest = all.wrapping_sub(step.wrapping_shl(self.log2));
        // Between two numbers of 16 bits.
        numeric::i32_to_u16(numeric::add_i32(mean.into(), step))
    }

    /// The variance of the mean after this row, as a share of a row's.
    fn share(&self, before: f32) -> f32 {
        let part = 1.0 / 1u32.wrapping_shl(self.log2) as f32;
        (1.0 - part) * (1.0 - part) * before + part * part
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::Polarity;
    use crate::tests::{bare, uniform};

    const SHIELDED: usize = 4;
    const PIXELS: usize = 64;

    fn geometry(polarity: Polarity) -> Geometry {
        Geometry {
            shielded: 0..SHIELDED,
            light: SHIELDED..SHIELDED + PIXELS,
            ..bare(SHIELDED + PIXELS, polarity)
        }
    }

    /// The words of a row: shielded pixels at 300, and light pixels.
    fn words(geometry: &Geometry, light: impl Fn(usize) -> u16) -> [u16; SHIELDED + PIXELS] {
        core::array::from_fn(|word| {
            word.checked_sub(SHIELDED).map_or(300, &light) ^ geometry.inverted()
        })
    }

    fn take(mean: &mut AmbientMean, geometry: &Geometry, light: impl Fn(usize) -> u16) {
        mean.take(&geometry.row(&words(geometry, light)).expect("a row"));
    }

    /// The counts of a row from which the mean is subtracted, and by how much its background became lower.
    fn subtracted(
        mean: &AmbientMean,
        geometry: &Geometry,
        light: impl Fn(usize) -> u16,
    ) -> ([u16; PIXELS], Counts) {
        let mut words = words(geometry, light);
        let lower = mean.subtract(&mut words, geometry).expect("subtracted");
        let row = geometry.row(&words).expect("a row");
        (
            core::array::from_fn(|i| row.light().get(i).expect("a pixel")),
            lower,
        )
    }

    /// Subtraction removes a slope and a pattern, to the count, for words that rise and words that fall.
    #[test]
    fn subtraction_removes_what_both_kinds_of_rows_share() {
        for polarity in [Polarity::Rising, Polarity::Falling] {
            let geometry = geometry(polarity);
            let ambient = |pixel: usize| 500 + 5 * pixel as u16 + 7 * (pixel as u16 % 3);
            let mut mean = AmbientMean::EMPTY;
            // No row with the laser off yet.
            let mut row = words(&geometry, ambient);
            assert_eq!(mean.subtract(&mut row, &geometry), None);
            assert_eq!(row, words(&geometry, ambient));
            (0..10).for_each(|_| take(&mut mean, &geometry, ambient));
            let spot = |pixel: usize| if pixel.abs_diff(30) < 5 { 2000 } else { 0 };
            let (found, lower) = subtracted(&mean, &geometry, |it| ambient(it) + spot(it));
            assert_eq!(found, core::array::from_fn(|pixel| 300 + spot(pixel)));
            // The mean of the ambient light above the black level.
            let sum: f64 = (0..PIXELS).map(|pixel| f64::from(ambient(pixel))).sum();
            let off = lower.to_f64() - (sum / PIXELS as f64 - 300.0);
            assert!(off.abs() <= 1.0 / 16.0, "{lower} {off}");
        }
    }

    #[test]
    fn a_saturated_pixel_stays_and_no_other_becomes_one() {
        let mut geometry = geometry(Polarity::Falling);
        geometry.saturation = 2500;
        let mut mean = AmbientMean::EMPTY;
        // Pixel 1 is darker than the black level.
        let dark = |pixel| if pixel == 1 { 200 } else { 400 };
        take(&mut mean, &geometry, dark);
        let counts = [2500, 2499, 4095, 2499, 0, 400];
        let (found, _) = subtracted(&mean, &geometry, |pixel| counts[pixel.min(5)]);
        assert_eq!(found[..6], [2500, 2499, 4095, 2399, 0, 300]);
    }

    /// A lamp goes out. The background stays at the black level, where it would lie below zero.
    #[test]
    fn no_count_is_cut_off_when_the_light_goes() {
        let geometry = geometry(Polarity::Rising);
        let mut mean = AmbientMean::EMPTY;
        take(&mut mean, &geometry, |pixel| 1300 + pixel as u16);
        let (found, lower) = subtracted(&mean, &geometry, |_| 300);
        assert_eq!(lower, Counts::default());
        let (least, most) = (found.iter().min(), found.iter().max());
        assert_eq!((least, most), (Some(&269), Some(&332)));
    }

    /// Rows of other light in succession begin the mean again; light that flickers does not.
    #[test]
    fn the_mean_begins_again_in_other_light() {
        let geometry = geometry(Polarity::Rising);
        let mut mean = AmbientMean::EMPTY;
        let level = |mean: &AmbientMean| f64::from(mean.level) / f64::from(ONE);
        for _ in 0..200 {
            take(&mut mean, &geometry, |_| 400);
        }
        for row in 1..=ROWS_OF_OTHER_LIGHT {
            take(&mut mean, &geometry, |_| 1400);
            println!("row {row} of other light: {}", level(&mean));
            let follows = row == ROWS_OF_OTHER_LIGHT;
            assert_eq!(level(&mean) == 1400.0, follows, "row {row}");
        }
        assert_eq!(mean.share(), Some(1.0));
        for _ in 0..200 {
            take(&mut mean, &geometry, |_| 1400);
        }
        for phase in 0..70 {
            // A lamp of 100 Hz, seen every 11.4 ms.
            let flicker = 300.0 * libm::sin(std::f64::consts::TAU * 1.14 * f64::from(phase));
            take(&mut mean, &geometry, |_| (1400.0 + flicker) as u16);
            assert!((level(&mean) - 1400.0).abs() < 10.0, "{}", level(&mean));
        }
        assert!(mean.share().expect("rows") < 0.005);
    }

    /// The share is the variance of the mean. The mean over all pixels is right to a tenth of a count,
    /// because rounding has no direction.
    #[test]
    fn the_mean_has_the_noise_that_it_states() {
        const NOISE: f64 = 4.0;
        let geometry = geometry(Polarity::Rising);
        let mut state = 19;
        let mut even = || 2.0 * f64::from(uniform(&mut state)) - 1.0;
        for rows in [1, 2, 3, 6, 12, 30, 80, 128, 400] {
            let (mut sum, mut squares, mut share) = (0.0, 0.0, 0.0);
            const REPEATS: usize = 160;
            for _ in 0..REPEATS {
                let mut mean = AmbientMean::EMPTY;
                for _ in 0..rows {
                    let row: [u16; PIXELS] =
                        core::array::from_fn(|_| (400.5 + even() * NOISE * 3f64.sqrt()) as u16);
                    take(&mut mean, &geometry, |pixel| row[pixel]);
                }
                for eight in mean.pixels[..PIXELS].as_chunks::<8>().0 {
                    // Of eight pixels together: their rounding cancels.
                    let error = |&pixel: &u16| f64::from(pixel) / f64::from(ONE) - 400.0;
                    let error = eight.iter().map(error).sum::<f64>();
                    sum += error;
                    squares += error * error;
                }
                share = mean.share().expect("rows").into();
            }
            let pixels = (PIXELS * REPEATS) as f64;
            let (error, variance) = (sum / pixels, squares / pixels);
            let measured = variance / (NOISE * NOISE + 1.0 / 12.0);
            println!("{rows} rows: share {share:.4}, measured {measured:.4}, error {error:.3}");
            // The relative standard deviation of a variance from 1280 sums is 4 %.
            assert!((measured / share - 1.0).abs() < 0.16, "{rows} rows");
            let most = 0.1 + 4.0 * (variance / pixels / 8.0).sqrt();
            assert!(error.abs() < most, "{rows} rows: {error}");
        }
    }

    /// For every step: the mean moves towards the value, and not beyond.
    #[test]
    fn a_step_stays_between_the_mean_and_the_value() {
        for rows in [0, 1, 2, 3, 4, 7, 8, 31, 64, 127, 128, 255] {
            let step = Step::after(rows, 0);
            for rest in 0..1 << step.log2 {
                for (mean, value) in [(0, 65_520), (65_520, 0), (100, 101), (101, 100), (7, 7)] {
                    let mut step = Step { rest, ..step };
                    let (low, high) = (mean.min(value), mean.max(value));
                    assert!((low..=high).contains(&step.towards(mean, value)));
                    assert!((0..1 << step.log2).contains(&step.rest));
                }
            }
        }
    }

    /// Light without noise that changes by a count: no pixel's step is a whole one, and yet all follow.
    #[test]
    fn the_mean_follows_a_small_change() {
        let geometry = geometry(Polarity::Rising);
        let mut mean = AmbientMean::EMPTY;
        for _ in 0..200 {
            take(&mut mean, &geometry, |_| 400);
        }
        for _ in 0..1000 {
            take(&mut mean, &geometry, |_| 401);
        }
        let pixels = &mean.pixels[..PIXELS];
        println!("{:?} to {:?}", pixels.iter().min(), pixels.iter().max());
        assert!(pixels.iter().all(|&pixel| pixel.abs_diff(401 * ONE) <= 2));
    }
}
