//! The phase-table score: two integer inner products and one division.
//!
//! A gaussian least-squares fit with amplitude, black level and width projected out in advance. The tables are designed
//! by the crate `phase-tables`, which explains them. Score / slope is the distance of the centre from a table's phase; a
//! third product, stretch / slope, says how far the spot's width is from the table's, and so picks the table.
//!
//! | | |
//! |---|---|
//! | samples | u16, at most 32760: counts of 12 bits, or sums of 2, 4 or 8 pixels, or halved sums of more |
//! | weights | i16, each row summing to zero, so a constant on the samples changes no bit |
//! | products | i32: no overflow, because sum of abs(weight) * 32760 < 2^31, proven by [`TableSet::new`] |
//! | division | f32: 24 bits on a quotient of at most a few pixels is 1e-7 pixel; one instruction on the chip |
//! | centre | Q16.16 pixels |
//!
//! Every float operation here is a single IEEE 754 operation or `libm`'s, so the chip and a PC agree bit for bit.

use crate::estimator::{RowCentre, WidthClass};
use crate::reading::Fault;
use crate::row::{Geometry, LARGEST_COUNT, Row};
use crate::spot::Spot;
use crate::units::{Counts, Pixels};

/// Weights for one width.
#[derive(Clone, Copy, Debug)]
pub struct Table<'a> {
    /// The width (a gaussian's sigma) in samples.
    pub width: f32,
    /// Samples to either side of the middle one.
    pub half_width: u16,
    /// Number of sub-pixel phases; phase k is at (k - (phases - 1)/2) / phases samples from the middle.
    pub phases: u16,
    /// Weights of the score, phase after phase.
    pub score: &'a [i16],
    /// Weights of its slope.
    pub slope: &'a [i16],
    /// Weights of the stretch.
    pub stretch: &'a [i16],
    /// Samples that score / slope = 1 stands for.
    pub centre_per_ratio: f32,
    /// Relative excess of width that stretch / slope = 1 stands for.
    pub stretch_per_ratio: f32,
    /// Counts of a sample at the peak that slope = 1 stands for.
    pub height_per_slope: f32,
    /// Variance of the centre times slope^2 for noise of one count^2 in each sample.
    pub variance_per_noise: f32,
    /// The same for shot noise of a spot one count high at one electron a count.
    pub variance_per_height: f32,
}

/// Tables for rising widths, proven.
#[derive(Clone, Copy, Debug)]
pub struct TableSet<'a>(&'a [Table<'a>]);

/// Why tables cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableError {
    /// There are none, or more than 64.
    Count,
    /// Half width, phases and number of weights do not agree, the window is longer than [`MAX_TAPS`], or there are more
    /// than 64 phases.
    Shape,
    /// Weights do not sum to zero.
    Sum,
    /// An inner product with the largest samples could overflow.
    Overflow,
    /// The widths are not positive, do not rise, or are wider than their window.
    Widths,
    /// A scale is not positive and finite.
    Scales,
}

/// The largest sample that tables are proven for.
pub const LARGEST_SAMPLE: u16 = 8 * LARGEST_COUNT;

/// The longest window in samples.
pub const MAX_TAPS: usize = 96;

/// Pixels in a sample of a spot that is wider than any table. Up to 8 their sum fits [`LARGEST_SAMPLE`]; more are even, so that
/// half of the sum does and a constant on the row still adds a whole number. With the widths of the tables there is a match
/// to 5 % for every width up to 144 pixels, but for 7 % near 11 and 13 (a test says so).
const BLOCKS: [u8; 11] = [2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16];

const _: () = {
    let mut i = 0;
    while i < BLOCKS.len() {
        let (block, halvings) = (BLOCKS[i] as u32, halvings(BLOCKS[i]));
        assert!((block * LARGEST_COUNT as u32) >> halvings <= LARGEST_SAMPLE as u32);
        assert!(block % (1 << halvings) == 0);
        i += 1;
    }
};

mod generated {
    use super::Table;
    include!(concat!(env!("OUT_DIR"), "/gaussian.rs"));
    pub(super) static GAUSSIAN: &[Table<'static>] = &TABLES;
}

/// The tables of the gaussian at r = 0.3: at most 1.10 of the bound in white noise, and 1.16 in pure shot noise.
pub static GAUSSIAN: TableSet<'static> = match TableSet::new(generated::GAUSSIAN) {
    Ok(set) => set,
    Err(_) => panic!("the generated tables are unfit"),
};

impl<'a> TableSet<'a> {
    /// Takes tables after proving them: sums of zero, and no overflow with samples up to [`LARGEST_SAMPLE`].
    ///
    /// # Errors
    /// [`TableError`] says which proof failed.
    pub const fn new(tables: &'a [Table<'a>]) -> Result<Self, TableError> {
        if tables.is_empty() || tables.len() > 64 {
            return Err(TableError::Count);
        }
        let mut narrower = 0.0;
        let mut i = 0;
        while i < tables.len() {
            let table = &tables[i];
            let taps = table.taps();
            // Bounded first, so that their product cannot overflow.
            if taps > MAX_TAPS || table.phases == 0 || table.phases > 64 {
                return Err(TableError::Shape);
            }
            let weights = taps * table.phases as usize;
            if table.score.len() != weights
                || table.slope.len() != weights
                || table.stretch.len() != weights
            {
                return Err(TableError::Shape);
            }
            // Not `<=`: a width that is not a number must not pass either.
            if !(table.width > narrower && table.width <= taps as f32) {
                return Err(TableError::Widths);
            }
            narrower = table.width;
            if !table.scales_are_positive() {
                return Err(TableError::Scales);
            }
            let mut start = 0;
            while start < weights {
                if let Err(error) = prove(table.score, start, taps) {
                    return Err(error);
                }
                if let Err(error) = prove(table.slope, start, taps) {
                    return Err(error);
                }
                if let Err(error) = prove(table.stretch, start, taps) {
                    return Err(error);
                }
                start += taps;
            }
            i += 1;
        }
        Ok(Self(tables))
    }

    /// The tables.
    pub const fn tables(&self) -> &'a [Table<'a>] {
        self.0
    }

    /// Whether a spot of this width in pixels is one.
    fn serves(&self, width: f32) -> bool {
        let largest_block = f32::from(BLOCKS[BLOCKS.len() - 1]);
        let widest = self.0.last().map_or(0.0, |table| table.width);
        (NARROWEST..widest * largest_block * WIDEST_SERVED).contains(&width)
    }

    /// The pixels in a sample and the table that match a width in pixels best, and how far they are from a match.
    fn choose(&self, width: f32) -> Option<Match<'a>> {
        let widest = self.0.last()?.width;
        let single = width <= widest * WIDEST_SINGLE;
        let blocks: &[u8] = if single { &[1] } else { &BLOCKS };
        let mut best: Option<Match<'a>> = None;
        for &block in blocks {
            let samples = width / f32::from(block);
            if !single && samples < FEWEST_SAMPLES && best.is_some() {
                break;
            }
            for (index, table) in self.0.iter().enumerate() {
                let off = mismatch(samples / table.width, block);
                if best.as_ref().is_none_or(|best| off < best.off) {
                    best = Some(Match {
                        class: WidthClass {
                            table: index as u8,
                            block,
                        },
                        table,
                        off,
                    });
                }
            }
        }
        best
    }
}

/// A table that may serve a width.
struct Match<'a> {
    class: WidthClass,
    table: &'a Table<'a>,
    /// See [`mismatch`].
    off: f32,
}

/// How far a spot `ratio` times as wide as a table is from where the table serves best.
///
/// With single pixels the tables' widths are 1.2 apart, and a table serves from 0.95 to 1.14 of its own: with r = 0.3 the
/// standard deviation in white noise is then 1.083 to 1.02 of the bound (1.057 at the table's width), and in pure shot noise
/// 1.09 to 1.16 (1.10). Blocks can be chosen to match.
fn mismatch(ratio: f32, block: u8) -> f32 {
    let best = if block == 1 { 1.04 } else { 1.0 };
    (ratio / best - 1.0).abs()
}

/// Spots up to this much wider than the widest table are fitted in single pixels.
const WIDEST_SINGLE: f32 = 1.14;

/// Samples a sigma of a spot in blocks: fewer lose accuracy (2.6 cost 0.9 %).
const FEWEST_SAMPLES: f32 = 3.4;

/// One row of weights: it sums to zero, and its inner product with samples up to [`LARGEST_SAMPLE`] fits an i32 at
/// every step of the sum.
const fn prove(weights: &[i16], start: usize, taps: usize) -> Result<(), TableError> {
    let (mut sum, mut largest) = (0i64, 0i64);
    let mut i = start;
    while i < start + taps {
        let weight = weights[i] as i64;
        sum += weight;
        largest += weight.abs() * LARGEST_SAMPLE as i64;
        i += 1;
    }
    if sum != 0 {
        Err(TableError::Sum)
    } else if largest > i32::MAX as i64 {
        Err(TableError::Overflow)
    } else {
        Ok(())
    }
}

impl Table<'_> {
    /// Samples in a window.
    pub const fn taps(&self) -> usize {
        2 * self.half_width as usize + 1
    }

    const fn scales_are_positive(&self) -> bool {
        let scales = [
            self.centre_per_ratio,
            self.stretch_per_ratio,
            self.height_per_slope,
            self.variance_per_noise,
            self.variance_per_height,
        ];
        let mut i = 0;
        while i < scales.len() {
            if !(scales[i] > 0.0 && scales[i].is_finite()) {
                return false;
            }
            i += 1;
        }
        true
    }
}

/// Where a window lies on the row and which phase serves it.
struct Window {
    class: WidthClass,
    /// The first pixel; negative where the window reaches over the sensor's edge.
    first: i32,
    phase: i32,
}

/// A window is moved and its table changed until both fit, at most this often.
const MAX_PASSES: usize = 10;

/// How nearly a window and a table must fit: to a tenth more than half a phase, and to 2 % in width. In noise two tables, or
/// two phases, may each hand the spot to the other; from the fifth pass either is good enough.
const fn slack(pass: usize) -> (f32, f32) {
    if pass < 4 { (0.55, 0.02) } else { (1.1, 0.1) }
}

/// No optics makes a spot narrower than this, in pixels: a hot pixel alone looks like one of 0.3.
const NARROWEST: f32 = 0.6;

/// No table serves spots wider than this times the widest one's width in the largest blocks: 151 pixels.
const WIDEST_SERVED: f32 = 1.1;

/// Where a window reaches over the sensor's edge a table this much narrower is tried: the coarse search may take a spot for
/// twice as wide as it is, and be off by half its width.
const NARROWER: f32 = 0.7;

/// A centre less certain than an eighth of the spot's width is not trusted: noise alone may look like that spot.
const DIMMEST: f32 = 8.0;

/// The centre of a spot that [`crate::spot::find`] found.
///
/// # Errors
/// [`Fault::SpotAtEdge`] where the window would be cut by the sensor's edge, [`Fault::Saturated`] where a pixel within
/// two widths of the centre is at full scale, [`Fault::TooDim`] where the noise leaves the centre uncertain by more than
/// an eighth of the width, [`Fault::NoSpot`] where no table fits what is there.
pub fn centre(
    row: &Row<'_>,
    spot: &Spot,
    geometry: &Geometry,
    tables: &TableSet<'_>,
) -> Result<RowCentre, Fault> {
    let light = row.light();
    let start = match i32::try_from(spot.centre) {
        Ok(start) if spot.centre < light.len() => Pixels::from_int(start),
        _ => {
            return Err(Fault::SpotAtEdge {
                centre: Pixels::MAX,
            });
        }
    };
    // The coarse kernel fits a width of 0.9 of its block best.
    let start_width = 0.9 * (1u32 << spot.block_log2.min(7)) as f32;
    saturation(light, start, start_width, geometry)?;
    let no_spot = Fault::NoSpot {
        amplitude: spot.height,
    };
    let fit = settle(light, start, start_width, tables).map_err(|error| match error {
        Unsettled::Edge(centre) => Fault::SpotAtEdge { centre },
        Unsettled::Shape => no_spot,
        // Noise may keep a table from fitting too.
        Unsettled::Never(fit) => match fit.with_uncertainty(spot.background.noise, geometry) {
            Err(too_dim) => too_dim,
            Ok(_) => no_spot,
        },
    })?;
    saturation(light, fit.centre, fit.width, geometry)?;
    fit.with_uncertainty(spot.background.noise, geometry)
}

/// A table that fits, and what it says.
struct Fit<'a> {
    centre: Pixels,
    /// Sigma in pixels.
    width: f32,
    /// The spot's width over the table's, less one.
    stretch: f32,
    slope: f32,
    class: WidthClass,
    table: &'a Table<'a>,
}

/// Why no table fits.
enum Unsettled<'a> {
    /// The window reaches over the sensor's edge.
    Edge(Pixels),
    /// What is there is no spot.
    Shape,
    /// Neither place nor width came to rest; this was the last of them.
    Never(Fit<'a>),
}

/// Moves the window to the centre and changes the table to the width until both rest.
fn settle<'a>(
    light: &[u16],
    start: Pixels,
    start_width: f32,
    tables: &TableSet<'a>,
) -> Result<Fit<'a>, Unsettled<'a>> {
    let (mut at, mut width) = (start, start_width);
    let Match {
        mut class,
        mut table,
        ..
    } = tables.choose(width).ok_or(Unsettled::Shape)?;
    let (mut cut, mut last) = (false, None);
    for pass in 0..MAX_PASSES {
        let (window, reference) = place(at, class, table);
        let Some(products) = inner_products(light, &window, table) else {
            // The place or the width may still be off: a narrower table mends either, where the spot is whole.
            cut = true;
            width = table.width * f32::from(class.block) * NARROWER;
            Match { class, table, .. } = tables.choose(width).ok_or(Unsettled::Shape)?;
            if width < NARROWEST {
                break;
            }
            continue;
        };
        if products.slope <= 0 {
            return Err(Unsettled::Shape);
        }
        let slope = products.slope as f32;
        let block = f32::from(class.block);
        // Limited to one and a half widths, and to a bit less than half or twice the width: further off, the products
        // say the direction and no more.
        let reach = 1.5 * table.width;
        let distance = limited(
            products.score as f32 / slope * table.centre_per_ratio,
            -reach,
            reach,
        );
        let stretch = limited(
            products.stretch as f32 / slope * table.stretch_per_ratio,
            -0.4,
            0.7,
        );
        // A position is below 2^12 pixels, and a distance below 1.5 * 96 * 16 < 2^12 (`new` bounds the widths).
        at = Pixels::from_bits(
            reference
                .to_bits()
                .saturating_add(Pixels::from_f32(distance * block).to_bits()),
        );
        width = table.width * block * (1.0 + stretch);
        if at.to_bits().abs_diff(start.to_bits())
            > Pixels::from_f32(4.0 * start_width).to_bits().unsigned_abs()
        {
            return Err(Unsettled::Shape);
        }
        let (half_phase, margin) = slack(pass);
        // Single pixels: the next phase would be nearer. Blocks: the window moves by pixels, a fraction of a block.
        let steps = if class.block == 1 {
            f32::from(table.phases)
        } else {
            block
        };
        let better = tables.choose(width).ok_or(Unsettled::Shape)?;
        let fits = mismatch(1.0 + stretch, class.block) <= better.off + margin;
        let fit = Fit {
            centre: at,
            width,
            stretch,
            slope,
            class,
            table,
        };
        if fits && distance.abs() * steps <= half_phase {
            return if tables.serves(width) {
                Ok(fit)
            } else {
                Err(Unsettled::Shape)
            };
        }
        last = Some(fit);
        if !fits {
            (class, table) = (better.class, better.table);
        }
    }
    Err(match last {
        _ if cut => Unsettled::Edge(at),
        Some(fit) => Unsettled::Never(fit),
        None => Unsettled::Shape,
    })
}

/// `f32::clamp` without its panic on bounds that are not in order, which brings 20 KB of formatting to the chip.
#[allow(clippy::manual_clamp)]
fn limited(value: f32, low: f32, high: f32) -> f32 {
    value.max(low).min(high)
}

impl Fit<'_> {
    /// Amplitude and uncertainty: the noise of the score through its slope.
    fn with_uncertainty(&self, noise: Counts, geometry: &Geometry) -> Result<RowCentre, Fault> {
        let block = f32::from(self.class.block);
        // A sample is the sum of a block's pixels over this.
        let divisor = (1u32 << halvings(self.class.block)) as f32;
        let height = self.slope * self.table.height_per_slope;
        let read = noise.to_f32() * noise.to_f32() * block / (divisor * divisor);
        let shot_variance_per_count = f32::from(geometry.shot_variance_per_count_q16) / 65536.0;
        // The table's shot noise is that of a spot of its own width; the variance grows as width^1.5 about it (1.44 to
        // 1.60 over the tables).
        let shot = height / divisor * shot_variance_per_count * (1.0 + 1.5 * self.stretch);
        let variance = self.table.variance_per_noise * read + self.table.variance_per_height * shot;
        let uncertainty = libm::sqrtf(variance) / self.slope * block;
        let amplitude = height * divisor / block;
        // An uncertainty that is not a number is not certain either.
        let certain = uncertainty * DIMMEST <= self.width;
        if !certain {
            let needed = amplitude * uncertainty * DIMMEST / self.width;
            return Err(Fault::TooDim {
                amplitude: Counts::from_f32(amplitude),
                needed: Counts::from_f32(needed),
            });
        }
        Ok(RowCentre {
            centre: self.centre,
            uncertainty: Pixels::from_f32(uncertainty),
            amplitude: Counts::from_f32(amplitude),
            width: Pixels::from_f32(self.width),
            class: self.class,
        })
    }
}

/// The window whose phase is nearest to a position, and that phase's place on the row.
fn place(at: Pixels, class: WidthClass, table: &Table<'_>) -> (Window, Pixels) {
    const HALF: i32 = 1 << (Pixels::FRACTION - 1);
    // Positions stay within 2^13 pixels of zero and offsets below 2^5, so nothing here overflows an i32 in Q16.
    let at = at.to_bits();
    let block = i32::from(class.block);
    let phases = i32::from(table.phases);
    let phase = if class.block == 1 {
        let nearest = at.saturating_add(HALF) >> Pixels::FRACTION;
        let from_its_edge = at - (nearest << Pixels::FRACTION) + HALF;
        ((from_its_edge * phases) >> Pixels::FRACTION).clamp(0, phases - 1)
    } else {
        phases / 2
    };
    // Where the phase lies from the middle sample's first pixel: half a block less half a pixel, and the phase itself.
    let offset = (block - 1) * HALF + (2 * phase - (phases - 1)) * block * HALF / phases;
    let middle = (at - offset).saturating_add(HALF) >> Pixels::FRACTION;
    let first = middle - i32::from(table.half_width) * block;
    (
        Window {
            class,
            first,
            phase,
        },
        Pixels::from_bits((middle << Pixels::FRACTION) + offset),
    )
}

/// The three sums over a window, each proven to fit.
struct Products {
    score: i32,
    slope: i32,
    stretch: i32,
}

/// `None` where the window reaches over an edge.
fn inner_products(light: &[u16], window: &Window, table: &Table<'_>) -> Option<Products> {
    let taps = table.taps();
    let first = usize::try_from(window.first).ok()?;
    let pixels = light.get(first..first + taps * usize::from(window.class.block))?;
    let phase = usize::try_from(window.phase).ok()?;
    let rows = phase * taps..(phase + 1) * taps;
    let (score, slope, stretch) = (
        table.score.get(rows.clone())?,
        table.slope.get(rows.clone())?,
        table.stretch.get(rows)?,
    );
    let mut sums = [0u16; MAX_TAPS];
    let samples = if window.class.block == 1 {
        pixels
    } else {
        sum_blocks(pixels, window.class.block, &mut sums);
        sums.get(..taps)?
    };
    let mut products = Products {
        score: 0,
        slope: 0,
        stretch: 0,
    };
    for (((&sample, &score), &slope), &stretch) in samples.iter().zip(score).zip(slope).zip(stretch)
    {
        let sample = i32::from(sample);
        // No step overflows: `prove` bounds the sum of the terms' magnitudes.
        products.score += sample * i32::from(score);
        products.slope += sample * i32::from(slope);
        products.stretch += sample * i32::from(stretch);
    }
    Some(products)
}

/// How often the sum of a block is halved to fit [`LARGEST_SAMPLE`]: not at all up to 8 pixels, once up to 16.
const fn halvings(block: u8) -> u32 {
    block.div_ceil(8).next_power_of_two().ilog2()
}

/// The sums of blocks of pixels, halved to fit. Adding n to every pixel adds a whole number to every sample, because a
/// block's size is a multiple of what its sum is divided by.
fn sum_blocks(pixels: &[u16], block: u8, sums: &mut [u16; MAX_TAPS]) {
    for (sum, pixels) in sums.iter_mut().zip(pixels.chunks_exact(usize::from(block))) {
        // 16 pixels of 12 bits fit 16 bits.
        *sum =
            (pixels.iter().map(|&count| u32::from(count)).sum::<u32>() >> halvings(block)) as u16;
    }
}

/// Counts the pixels at full scale within two widths.
fn saturation(light: &[u16], centre: Pixels, width: f32, geometry: &Geometry) -> Result<(), Fault> {
    let centre = usize::try_from(centre.to_bits() >> Pixels::FRACTION).unwrap_or_default();
    // `as` saturates.
    let reach = (2.0 * width) as usize + 1;
    let from = centre.saturating_sub(reach).min(light.len());
    let to = centre.saturating_add(reach + 1).min(light.len());
    let near = light.get(from..to).unwrap_or_default();
    match near
        .iter()
        .filter(|&&count| count >= geometry.full_scale())
        .count()
    {
        0 => Ok(()),
        pixels => Err(Fault::Saturated {
            pixels: u16::try_from(pixels).unwrap_or(u16::MAX),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_width_has_a_table_that_matches() {
        let (mut off_single, mut off_blocks) = (0.0f32, 0.0f32);
        for step in 0..5200 {
            let width = 0.8 * libm::powf(1.001, step as f32);
            let Match { class, off, .. } = GAUSSIAN.choose(width).expect("a table");
            let worst = if class.block == 1 {
                &mut off_single
            } else {
                &mut off_blocks
            };
            *worst = worst.max(if width > 144.0 { 0.0 } else { off });
        }
        println!("off by {off_single} in single pixels, by {off_blocks} in blocks");
        assert!(
            off_single <= 0.1 && off_blocks <= 0.072,
            "{off_single} {off_blocks}"
        );
    }

    #[test]
    fn unfit_tables_are_refused() {
        let good = generated::GAUSSIAN[5];
        let error = |table: Table<'_>| TableSet::new(&[table]).err();
        assert_eq!(error(good), None);
        assert_eq!(TableSet::new(&[]).err(), Some(TableError::Count));
        assert_eq!(TableSet::new(&[good, good]).err(), Some(TableError::Widths));
        assert_eq!(
            error(Table {
                width: f32::NAN,
                ..good
            }),
            Some(TableError::Widths)
        );
        assert_eq!(
            error(Table {
                width: 1000.0,
                ..good
            }),
            Some(TableError::Widths)
        );
        assert_eq!(error(Table { phases: 1, ..good }), Some(TableError::Shape));
        assert_eq!(
            error(Table {
                half_width: u16::MAX,
                ..good
            }),
            Some(TableError::Shape)
        );
        assert_eq!(
            error(Table {
                variance_per_noise: f32::NAN,
                ..good
            }),
            Some(TableError::Scales)
        );
        assert_eq!(
            error(Table {
                centre_per_ratio: 0.0,
                ..good
            }),
            Some(TableError::Scales)
        );
        let mut weights = good.score.to_vec();
        weights[0] += 1;
        assert_eq!(
            error(Table {
                score: &weights,
                ..good
            }),
            Some(TableError::Sum)
        );
        let large: std::vec::Vec<i16> = (0..weights.len())
            .map(|i| [30_000, -30_000, 0][i % good.taps() % 3])
            .collect();
        let error = error(Table {
            score: &large,
            ..good
        });
        assert!(
            matches!(error, Some(TableError::Overflow | TableError::Sum)),
            "{error:?}"
        );
    }

    #[test]
    fn a_candidate_beside_the_row_is_at_the_edge() {
        let light = [100u16; 64];
        let row = Row::new(&light, &[]).expect("a row");
        let background = crate::spot::Background {
            level: Counts::from_int(100),
            noise: Counts::from_int(1),
        };
        for centre in [64, 32_768, usize::MAX] {
            let spot = Spot {
                centre,
                block_log2: 31,
                height: Counts::from_int(0),
                background,
            };
            let fault = centre_of(&row, &spot);
            assert!(matches!(fault, Err(Fault::SpotAtEdge { .. })), "{fault:?}");
        }
    }

    fn centre_of(row: &Row<'_>, spot: &Spot) -> Result<RowCentre, Fault> {
        centre(row, spot, &crate::sensor_heads::tcd1304dg(), &GAUSSIAN)
    }
}
