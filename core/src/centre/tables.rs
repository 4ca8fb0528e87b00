//! The phase tables: their weights, the proof that they cannot overflow, the choice of a table for a spot,
//! and a table's window on the row, which sums pixels into samples and weighs them by the nearest phase.
//!
//! The crate `phase-tables` designs the weights and explains them; `build.rs` writes those of the gaussian.

use dual_mac::{Pair, Pairs, dot, dot2, upper_product};

use crate::base::Pixels;
use crate::base::numeric::{
    i64_to_i32, inverse, inverse_root, inverse_root_of_64, mul_i32, product, saturated, shifted_32,
    whole_u16,
};
use crate::centre::WidthClass;
use crate::row::{LARGEST_COUNT, Light};

/// Weights for one width.
#[derive(Clone, Copy, Debug)]
pub struct Table<'a> {
    /// Samples to either side of the middle one.
    pub half_width: u8,
    /// Number of sub-pixel phases; phase k is at (k - (phases - 1)/2) / phases samples from the middle.
    pub phases: u8,
    /// Weights of the score and of its slope: [`Table::pairs`] for each phase, one phase after the other. The
    /// weights of a phase's last sample are zero.
    pub weights: &'a [Pairs],
    /// Weights of the stretch, in the same order.
    pub stretch: &'a [Pair],
    /// The width (a gaussian's sigma) in samples, Q16.
    pub width: i32,
    /// One over the width in samples, Q30.
    pub per_width: i32,
    /// A centre within this many samples, Q26, of its phase needs no second measurement from a nearer phase.
    pub near_limit: i32,
    /// Distance in samples where score / slope = 1, Q25.
    pub centre_per_ratio: i32,
    /// Correction of the distance, in 1/samples^2, Q31: if the ratio says q samples, the distance is
    /// q - bend q^3.
    pub bend: i32,
    /// Relative excess of the spot's width where stretch / slope = 1, Q25.
    pub stretch_per_ratio: i32,
    /// Counts of a sample at the peak where slope = 1, Q42.
    pub height_per_slope: i32,
    /// Standard deviation of the centre in samples, times slope, for noise of one count in each sample, Q13.
    pub deviation_per_noise: i32,
    /// The centre's variance by the shot noise of a spot one count high, at one electron a count, over that
    /// by noise of one count in each sample, Q28.
    pub shot_share: i32,
}

/// Tables for rising widths, with proven weights.
#[derive(Clone, Copy, Debug)]
pub struct TableSet<'a> {
    tables: &'a [Table<'a>],
    /// Tells the sets of the core apart in a [`WidthClass`].
    pub(crate) number: u8,
    /// How far a spot's width may be from a table's, relative, Q24. Half a step between the widths, beyond
    /// which another table fits better, and a tenth of a step for noise.
    pub(super) largest_mismatch: i32,
    /// The largest width, in samples, Q16: the widest table still serves half a step beyond its own.
    widest: i32,
}

/// Why tables cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableError {
    /// There are none, or more than 64.
    Count,
    /// Half width, phases and number of weights do not agree, the window is longer than [`MAX_TAPS`], or
    /// there are more than 64 phases.
    Shape,
    /// Weights do not sum to zero.
    Sum,
    /// An inner product with the largest samples could overflow.
    Overflow,
    /// The widths are not positive, do not rise, or are wider than their window, or the second is more than
    /// 200 times the first.
    Widths,
    /// `per_width` is not one over the width. Or another scale is too small to keep its precision. Or a
    /// window rests two samples or more from its phase, or further than a quotient reaches. Or the bend is
    /// more than 5 % there.
    Scales,
}

/// The number of every set that is not the core's own. The core cannot tell such sets apart, so a result of
/// one of them must not be the `before` of another.
const FOREIGN: u8 = u8::MAX;
/// The largest sample that tables are proven for.
pub const LARGEST_SAMPLE: u16 = 8 * LARGEST_COUNT;

const _: () = assert!(LARGEST_SAMPLE <= dual_mac::LARGEST_SAMPLE);

/// The longest window in samples, with the one that makes it even.
pub const MAX_TAPS: usize = 116;
/// Sizes of a sample in pixels. The sum of up to 8 pixels fits [`LARGEST_SAMPLE`], and so does half of the
/// sum of 16. A constant on the row adds a whole number to each sample.
pub const BLOCKS: [u8; 5] = [1, 2, 4, 8, 16];

const _: () = {
    let mut i = 0;
    while i < BLOCKS.len() {
        let (block, halvings) = (BLOCKS[i] as u32, halvings(BLOCKS[i] as usize));
        assert!((block * LARGEST_COUNT as u32) >> halvings <= LARGEST_SAMPLE as u32);
        assert!(block % (1 << halvings) == 0);
        i += 1;
    }
};

mod generated {
    use super::Table;
    use dual_mac::{Pair, Pairs};
    include!(concat!(env!("OUT_DIR"), "/tables.rs"));
}

/// One set for every row. If the table's width is the spot's, the uncertainty is at most 1.08 of the bound in
/// read noise and 1.09 in shot noise.
pub static GAUSSIAN: TableSet<'static> = proven(0, generated::GAUSSIAN);

/// Tables for the diffraction pattern of a slit, eq. (6).
pub static SLIT: TableSet<'static> = proven(1, generated::SLIT);

/// Tables for a background that rises or falls along the row.
pub static TILTED: TableSet<'static> = proven(2, generated::TILTED);

/// Tables for a lopsided spot, as speckle makes it on a rough surface.
pub static LOPSIDED: TableSet<'static> = proven(7, generated::LOPSIDED);

/// The best tables for each mix of noise, from read noise alone (least squares) to shot noise alone. They are
/// designed for ratios of infinity, 0.23, 0.07, 0.02 and 0.006. Between these ratios they lose at most 2.1 %
/// (at 0.9), and 3.4 % half a step from a table's width. Each comes with the least ratio for it: the read
/// noise's variance over the shot noise's at the peak, Q16.
pub static MIXES: [(u16, &TableSet<'static>); 5] = [
    (q16(0.9), &READ_NOISE),
    (q16(0.12), &GAUSSIAN),
    (q16(0.037), &MOSTLY_SHOT_NOISE),
    (q16(0.011), &SHOT_NOISE),
    (0, &PURE_SHOT_NOISE),
];

const fn q16(value: f32) -> u16 {
    whole_u16(value * 65536.0)
}

static READ_NOISE: TableSet<'static> = proven(3, generated::READ_NOISE);
static MOSTLY_SHOT_NOISE: TableSet<'static> = proven(4, generated::MOSTLY_SHOT_NOISE);
static SHOT_NOISE: TableSet<'static> = proven(5, generated::SHOT_NOISE);
static PURE_SHOT_NOISE: TableSet<'static> = proven(6, generated::PURE_SHOT_NOISE);

const fn proven(number: u8, tables: &'static [Table<'static>]) -> TableSet<'static> {
    match TableSet::new(tables) {
        Ok(set) => TableSet { number, ..set },
        Err(_) => panic!("the generated tables are unfit"),
    }
}

impl<'a> TableSet<'a> {
    /// Takes tables after proving them: sums of zero, and no overflow with samples up to [`LARGEST_SAMPLE`].
    ///
    /// # Errors
    /// [`TableError`] says which proof failed.
    pub const fn new(tables: &'a [Table<'a>]) -> Result<Self, TableError> {
        if tables.is_empty() || tables.len() > 64 {
            return Err(TableError::Count);
        }
        let mut narrower = 0;
        let mut i = 0;
        while i < tables.len() {
            let table = &tables[i];
            let taps = table.taps();
            if taps >= MAX_TAPS || table.phases == 0 || table.phases > 64 {
                return Err(TableError::Shape);
            }
            let pairs = table.pairs() * table.phases as usize;
            if table.weights.len() != pairs || table.stretch.len() != pairs {
                return Err(TableError::Shape);
            }
            if table.width <= narrower || table.width as i64 > taps as i64 * (1 << 16) {
                return Err(TableError::Widths);
            }
            narrower = table.width;
            if !table.has_fit_scales() {
                return Err(TableError::Scales);
            }
            let mut start = 0;
            while start < pairs {
                if let Err(error) = prove(table, start) {
                    return Err(error);
                }
                start += table.pairs();
            }
            i += 1;
        }
        // 0.6 of the step from the first width to the second, Q24.
        let largest_mismatch = if tables.len() > 1 {
            let (first, second) = (tables[0].width as i64, tables[1].width as i64);
            (second - first) * 3 * (1 << 24) / (5 * first)
        } else {
            // A single table serves all widths.
            i32::MAX as i64
        };
        let widest = tables[tables.len() - 1].width as i64;
        let widest = widest + ((widest * largest_mismatch) >> 24);
        if largest_mismatch > i32::MAX as i64 || widest > i32::MAX as i64 {
            return Err(TableError::Widths);
        }
        Ok(Self {
            tables,
            number: FOREIGN,
            largest_mismatch: i64_to_i32(largest_mismatch),
            widest: i64_to_i32(widest),
        })
    }

    /// The tables.
    pub const fn tables(&self) -> &'a [Table<'a>] {
        self.tables
    }

    /// Gets the table of a class, which the row before had. If that class is of another set, chooses the
    /// table for the width.
    #[inline]
    pub(super) fn get_or_choose(
        &self,
        class: WidthClass,
        width: Pixels,
    ) -> Option<(WidthClass, &'a Table<'a>)> {
        if class.set != self.number {
            return self.choose(width);
        }
        Some((class, self.get(class)?))
    }

    /// The table of a class. `None` if the class is of another set.
    #[inline(always)]
    pub(super) fn get(&self, class: WidthClass) -> Option<&'a Table<'a>> {
        let is_block = class.block.is_power_of_two() && class.block <= 16;
        if class.set != self.number || !is_block {
            return None;
        }
        self.tables.get(usize::from(class.table))
    }

    /// The pixels in a sample and the table that match a width best.
    pub(super) fn choose(&self, width: Pixels) -> Option<(WidthClass, &'a Table<'a>)> {
        let [.., most] = BLOCKS;
        let width = width.to_bits();
        // The width in samples of so many pixels, Q16.
        let samples = |block: u8| width >> block.trailing_zeros();
        let block = (BLOCKS.into_iter()).find(|&block| samples(block) <= self.widest);
        let block = block.unwrap_or(most);
        let samples = samples(block);
        // The widths are a geometric series: above the geometric mean of two neighbours the wider one is
        // nearer.
        let wider = self.tables.partition_point(|table| table.width < samples);
        let narrower = wider.saturating_sub(1);
        let index = match (self.tables.get(narrower), self.tables.get(wider)) {
            (Some(table), Some(next))
                if product(samples, samples) > product(table.width, next.width) =>
            {
                wider
            }
            _ => narrower,
        };
        let class = WidthClass {
            set: self.number,
            #[expect(clippy::cast_possible_truncation, reason = "a set has few tables")]
            table: index as u8,
            block,
        };
        Some((class, self.tables.get(index)?))
    }
}

/// Proves that each row of weights sums to zero, and that its inner product with samples up to
/// [`LARGEST_SAMPLE`] fits an i32 at every step of the sum.
const fn prove(table: &Table<'_>, start: usize) -> Result<(), TableError> {
    let (mut score, mut slope, mut stretch) = (Row::new(), Row::new(), Row::new());
    let mut i = start;
    while i < start + table.pairs() {
        score.add(table.weights[i].0);
        slope.add(table.weights[i].1);
        stretch.add(table.stretch[i]);
        i += 1;
    }
    let rows = [score, slope, stretch];
    let mut i = 0;
    while i < rows.len() {
        if rows[i].sum != 0 {
            return Err(TableError::Sum);
        }
        if rows[i].magnitudes * LARGEST_SAMPLE as i64 > i32::MAX as i64 {
            return Err(TableError::Overflow);
        }
        i += 1;
    }
    Ok(())
}

/// The sums over a row of weights.
#[derive(Clone, Copy)]
struct Row {
    sum: i64,
    magnitudes: i64,
}

impl Row {
    const fn new() -> Self {
        Self {
            sum: 0,
            magnitudes: 0,
        }
    }

    const fn add(&mut self, pair: Pair) {
        // At most MAX_TAPS weights of 16 bits.
        self.sum += pair.0 as i64 + pair.1 as i64;
        self.magnitudes += (pair.0 as i64).abs() + (pair.1 as i64).abs();
    }
}

impl Table<'_> {
    /// Samples in a window.
    #[inline]
    pub const fn taps(&self) -> usize {
        2 * self.half_width as usize + 1
    }

    /// Pairs of weights in a window.
    #[inline]
    pub const fn pairs(&self) -> usize {
        self.half_width as usize + 1
    }

    /// This table's width, with so many pixels in a sample.
    #[inline(always)]
    pub(super) fn width_in_pixels(&self, block: u8) -> Pixels {
        // `TableSet::new` has proven that a width is at most its window: 116 * 16 pixels fit Q16.
        Pixels::from_bits(mul_i32(self.width, block.into()))
    }

    /// A width over this table's, Q24. `block` is the number of pixels in a sample. Saturates.
    #[inline(always)]
    pub(super) fn ratio(&self, width: Pixels, block: u8) -> i32 {
        saturated(product(width.to_bits(), self.per_width) >> (22 + block.trailing_zeros()))
    }

    /// How far a width is from this table's, relative and without sign, Q24.
    #[inline(always)]
    pub(super) fn mismatch(&self, width: Pixels, block: u8) -> u32 {
        self.ratio(width, block).abs_diff(ONE_Q24)
    }

    const fn has_fit_scales(&self) -> bool {
        // The core's own scales have 25 to 30 bits.
        const LEAST: i32 = 1 << 24;
        // Quotients reach at least four. That of the stretch must reach 0.7, that of the score what is near.
        const LEAST_STRETCH: i32 = (1 << 25) / 5;
        let reach = 8 * self.centre_per_ratio as i64;
        // Q46. Its rounding is half a step of the width, which is below 2^7, and half a step of `per_width`.
        let off = product(self.width, self.per_width) - (1 << 46);
        // Below four, Q28. Its product with the bend has Q59.
        let square = product(self.near_limit, self.near_limit) >> 24;
        self.near_limit > 0
            && self.near_limit < 2 << 26
            && self.deviation_per_noise >= LEAST
            && self.height_per_slope >= LEAST
            && self.shot_share > 0
            && self.stretch_per_ratio >= LEAST_STRETCH
            && reach > self.near_limit as i64
            && reach > NEAR as i64
            && off.abs() <= self.per_width as i64
            && square * self.bend.unsigned_abs() as i64 <= (1i64 << 59) / 20
    }
}

/// One, Q24.
pub(super) const ONE_Q24: i32 = 1 << 24;

/// No optics makes a spot narrower than this, in pixels: a hot pixel alone looks like one of 0.3.
pub(super) const NARROWEST: Pixels = Pixels::from_positive_f32(0.6);
/// The coarse search finds no wider spots.
const WIDEST: Pixels = Pixels::from_int(150);

pub(super) fn is_spot_width(width: Pixels) -> bool {
    (NARROWEST..WIDEST).contains(&width)
}

/// How often the sum of a block is halved to fit [`LARGEST_SAMPLE`]: not at all up to 8 pixels, once for 16.
#[inline(always)]
pub(super) const fn halvings(block: usize) -> u32 {
    (block > 8) as u32
}

/// A centre within so many pixels of a window's phase has no nearer window, if samples have several pixels.
/// Half a pixel, because such a window moves by whole pixels, and 0.05 pixel more for noise: 0.55, Q26.
const NEAR: i32 = 36_909_875;

pub(super) struct Window<'r, 't> {
    pixels: Light<'r>,
    block: u8,
    table: &'t Table<'t>,
    weights: &'t [Pairs],
    /// The first of the phase's weights.
    start: usize,
    /// The place of the phase on the row.
    reference: Pixels,
}

pub(super) struct Score {
    pub(super) centre: Pixels,
    /// How far it is from the window's phase, in samples, Q26.
    pub(super) distance: i32,
    /// Beyond this distance, in samples, Q26, another phase or window is nearer.
    pub(super) near_limit: i32,
    /// Whether the distance is at most `near_limit`.
    pub(super) is_near: bool,
    pub(super) slope: Slope,
}

/// The slope of the score. It is positive, and proportional to the spot's height.
#[derive(Clone, Copy)]
pub(super) struct Slope {
    value: i32,
    /// 1 / value is per_slope * 2^(exponent - 60). This is 2^28 to 2^30.
    per_slope: i32,
    /// 0 to 30.
    exponent: i32,
}

impl Slope {
    #[inline(always)]
    pub(super) fn new(value: i32) -> Option<Self> {
        if value <= 0 {
            return None;
        }
        let (per_slope, exponent) = inverse(inverse_root(value.cast_unsigned()));
        Some(Self {
            value,
            per_slope,
            exponent,
        })
    }

    /// A product over the slope, Q25, right to 2^-23 of it and a step. Saturates, at four or more.
    #[inline(always)]
    fn divide(&self, product: i32) -> i32 {
        upper_product(
            shifted_32(product, self.exponent.wrapping_sub(3)),
            self.per_slope,
        )
    }

    /// The height of a sample at the peak, Q10.
    #[inline(always)]
    pub(super) fn height(&self, table: &Table<'_>) -> i32 {
        upper_product(self.value, table.height_per_slope)
    }

    /// The standard uncertainty of the centre, right to 2^-19 of it and a step. Saturates at 2^14 pixels.
    /// `variance` is a sample's in counts^2, Q16.
    #[inline(always)]
    pub(super) fn uncertainty(&self, variance: u64, table: &Table<'_>, block: u8) -> Pixels {
        // The root is (variance / 2^64) times what `inverse_root_of_64` says: `root` times 2^(4 - halvings)
        // of Q8.
        let (inverse, halvings) = inverse_root_of_64(variance);
        let highest = variance.wrapping_shl(2 * halvings) >> 33;
        let root = upper_product(i64_to_i32(highest.cast_signed()), inverse);
        // Below 2^28, so four times it fits.
        let of_score = upper_product(root, table.deviation_per_noise);
        let of_centre = upper_product(of_score.wrapping_mul(4), self.per_slope);
        // The Q formats leave a factor of 2, because 4 - 8 - 13 - 60 + 2 * 32 - 2 + 16 = 1. One more bit is
        // for rounding.
        let more = (self.exponent)
            .wrapping_sub(halvings.cast_signed())
            .wrapping_add(block.trailing_zeros().cast_signed());
        let twice = shifted_32(of_centre, more.wrapping_add(2));
        Pixels::from_bits((twice >> 1).wrapping_add(twice & 1))
    }
}

impl<'r, 't> Window<'r, 't> {
    /// The window whose phase is nearest to a position. `None` where it reaches over the sensor's edge.
    #[inline(always)]
    pub(super) fn place(
        light: Light<'r>,
        at: Pixels,
        class: WidthClass,
        table: &'t Table<'t>,
    ) -> Option<Self> {
        const ONE: i32 = 1 << Pixels::FRACTION;
        const HALF: i32 = ONE / 2;
        let phases = i32::from(table.phases);
        let half_width = i32::from(table.half_width);
        let pairs = table.pairs();
        let block = i32::from(class.block);
        // A position saturates at 2^15 pixels in Q16. Phases, half widths and blocks have 8 bits, so
        // everything else stays below 2^31.
        let (phase, first, reference) = if class.block == 1 {
            let from_its_edge = at.to_bits().saturating_add(HALF);
            let middle = from_its_edge >> Pixels::FRACTION;
            let (phase, offset) = if phases == 1 {
                (0, 0)
            } else {
                let phase = ((from_its_edge & 0xffff) * phases) >> Pixels::FRACTION;
                // Phase k lies (2 k + 1 - phases) / (2 phases) pixels from the middle.
                (
                    phase,
                    ((2 * phase + 1 - phases) * HALF).checked_div(phases)?,
                )
            };
            (
                phase,
                middle - half_width,
                (middle * ONE).saturating_add(offset),
            )
        } else {
            let phase = phases / 2;
            // The offset counts from the middle sample's first pixel. That sample's middle is (block - 1) / 2
            // pixels further.
            let beside = ((2 * phase + 1 - phases) * block * HALF).checked_div(phases)?;
            let offset = (block - 1) * HALF + beside;
            let middle =
                at.to_bits().saturating_sub(offset).saturating_add(HALF) >> Pixels::FRACTION;
            (
                phase,
                middle - half_width * block,
                (middle * ONE).saturating_add(offset),
            )
        };
        let first = usize::try_from(first).ok()?;
        let pixels = light.slice(first..first + 2 * pairs * usize::from(class.block))?;
        let start = phase.cast_unsigned() as usize * pairs;
        Some(Self {
            pixels,
            block: class.block,
            table,
            weights: table.weights.get(start..start + pairs)?,
            start,
            reference: Pixels::from_bits(reference),
        })
    }

    /// Measures the centre. `None` where the slope is not positive: it is proportional to the height of the
    /// spot.
    #[inline(always)]
    pub(super) fn score(&self) -> Option<Score> {
        // No step overflows: the tables are proven for the largest samples.
        let (score, slope) = if self.block == 1 {
            let (words, inverted) = self.pixels.words();
            let (score, slope) = dot2(words, self.weights);
            // The weights sum to zero: full scale less the words gives the negative sums.
            if inverted != 0 {
                (score.wrapping_neg(), slope.wrapping_neg())
            } else {
                (score, slope)
            }
        } else {
            self.score_of_blocks()
        };
        self.score_of(score, slope)
    }

    /// The centre of the two sums. `None` where the slope is not positive.
    #[inline(always)]
    fn score_of(&self, score: i32, slope: i32) -> Option<Score> {
        let slope = Slope::new(slope)?;
        let straight = saturated(product(slope.divide(score), self.table.centre_per_ratio) >> 24);
        let near_limit = if self.block == 1 {
            self.table.near_limit
        } else {
            // The window moves by pixels.
            NEAR >> self.block.trailing_zeros()
        };
        let is_near = straight.unsigned_abs() <= near_limit.cast_unsigned();
        let distance = if is_near {
            straight.wrapping_sub(self.bent(straight))
        } else {
            self.far(straight)
        };
        // In Q16. Saturates as the reference does.
        let from_reference = product(distance, self.block.into()).wrapping_add(1 << 9) >> 10;
        let from_reference = saturated(from_reference);
        let centre = self.reference.to_bits().saturating_add(from_reference);
        Some(Score {
            centre: Pixels::from_bits(centre),
            distance,
            near_limit,
            is_near,
            slope,
        })
    }

    /// bend q^3 of a distance q that is near: both are Q26.
    #[inline(always)]
    fn bent(&self, straight: i32) -> i32 {
        // `TableSet::new` has proven that a near distance is below two samples: Q30 holds it. So the square
        // has Q28, and its product with bend Q27. That is at most 5 %, or 8 % in samples of several pixels,
        // where a distance is below 0.28 and a bend below one.
        let straight = straight.wrapping_mul(1 << 4);
        let share = upper_product(self.table.bend, upper_product(straight, straight));
        upper_product(straight, share.wrapping_mul(1 << 4)) >> 3
    }

    /// The distance of a centre that is not near, Q26. Limited to one and a half widths: further off, score
    /// and bend tell only the direction.
    #[inline(never)]
    fn far(&self, straight: i32) -> i32 {
        // 1.5 * 2^10 widths of Q16.
        let reach = saturated(product(self.table.width, 3 << 9));
        let straight = straight.max(reach.wrapping_neg()).min(reach);
        // Q20, and with the bend Q19.
        let square = upper_product(straight, straight);
        const TENTH: i32 = (1 << 19) / 10;
        let bent = upper_product(self.table.bend, square).clamp(-TENTH, TENTH);
        saturated(product(straight, (1i32 << 19).wrapping_sub(bent)) >> 19)
    }

    pub(super) fn score_and_stretch(&self) -> Option<(Score, i32)> {
        if self.block == 1 {
            let score = self.score()?;
            let stretch = self.stretch(&score);
            return Some((score, stretch));
        }
        let mut sums = [0; MAX_TAPS];
        sum_blocks(self.pixels, self.block, &mut sums);
        let (score, slope) = dot2(&sums, self.weights);
        let score = self.score_of(score, slope)?;
        let stretch = self.stretch_of(dot(&sums, self.weights_of_stretch()), &score);
        Some((score, stretch))
    }

    /// The spot's width over the table's, less one, Q24. Limited to a bit less than half or twice the width,
    /// like the distance.
    #[inline(always)]
    pub(super) fn stretch(&self, score: &Score) -> i32 {
        let weights = self.weights_of_stretch();
        let product = if self.block == 1 {
            let (words, inverted) = self.pixels.words();
            let product = dot(words, weights);
            if inverted != 0 {
                product.wrapping_neg()
            } else {
                product
            }
        } else {
            self.stretch_of_blocks(weights)
        };
        self.stretch_of(product, score)
    }

    /// `TableSet::new` has proven that there are as many weights of the stretch as of the score.
    #[inline(always)]
    fn weights_of_stretch(&self) -> &'t [Pair] {
        self.table
            .stretch
            .get(self.start..self.start + self.weights.len())
            .unwrap_or_default()
    }

    #[inline(always)]
    fn stretch_of(&self, sum: i32, score: &Score) -> i32 {
        let ratio = score.slope.divide(sum);
        const LEAST: i32 = -(ONE_Q24 / 5 * 2);
        const MOST: i32 = ONE_Q24 / 10 * 7;
        saturated(product(ratio, self.table.stretch_per_ratio) >> 26).clamp(LEAST, MOST)
    }

    /// The width of a spot that has this stretch, Q24.
    #[inline(always)]
    pub(super) fn width(&self, stretch: i32) -> Pixels {
        let width = self.table.width_in_pixels(self.block).to_bits();
        let more = product(width, stretch).wrapping_add(1 << 23) >> 24;
        Pixels::from_bits(saturated(more.wrapping_add(width.into())))
    }

    // Not inlined: the sums take room on the stack and time to clear it, and single pixels need no sums.

    #[inline(never)]
    fn score_of_blocks(&self) -> (i32, i32) {
        // Coarse samples are few, and clearing room for more takes time.
        if self.weights.len() <= FEW_TAPS / 2 {
            let mut sums = [0; FEW_TAPS];
            sum_blocks(self.pixels, self.block, &mut sums);
            dot2(&sums, self.weights)
        } else {
            let mut sums = [0; MAX_TAPS];
            sum_blocks(self.pixels, self.block, &mut sums);
            dot2(&sums, self.weights)
        }
    }

    #[inline(never)]
    fn stretch_of_blocks(&self, weights: &[Pair]) -> i32 {
        let mut sums = [0; MAX_TAPS];
        sum_blocks(self.pixels, self.block, &mut sums);
        dot(&sums, weights)
    }
}

/// The most samples in a window of coarse samples: up to 2.3 samples a sigma, and four or five sigma to
/// either side.
const FEW_TAPS: usize = 24;

/// Sums blocks of pixels, and halves the sums to fit. Adding n to every pixel adds a whole number to every
/// sample, because a block's size is a multiple of what its sum is divided by.
fn sum_blocks(pixels: Light<'_>, block: u8, sums: &mut [u16]) {
    match block {
        2 => sum_chunks::<2>(pixels, sums),
        4 => sum_chunks::<4>(pixels, sums),
        8 => sum_chunks::<8>(pixels, sums),
        _ => sum_chunks::<16>(pixels, sums),
    }
}

// Two words at a time: half of a block of 16 pixels of 12 bits fits 16 bits.
#[inline(always)]
fn sum_chunks<const BLOCK: usize>(pixels: Light<'_>, sums: &mut [u16]) {
    let (words, inverted) = pixels.words();
    let inverted = u32::from(inverted).wrapping_mul(0x0001_0001);
    for (sum, block) in sums.iter_mut().zip(words.as_chunks::<BLOCK>().0) {
        let pairs = block.as_chunks::<2>().0.iter();
        let both = pairs
            .map(|&[low, high]| (u32::from(low) | (u32::from(high) * 0x1_0000)) ^ inverted)
            .fold(0, u32::wrapping_add);
        *sum = ((((both & 0xffff) + (both >> 16)) >> halvings(BLOCK)) & 0xffff) as u16;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_width_has_a_table_that_matches() {
        let (mut fine, mut coarse) = (0, 0);
        for step in 0..5100 {
            let width = Pixels::from_f32(0.8 * libm::powf(1.001, step as f32));
            for (tables, worst) in [(&GAUSSIAN, &mut fine), (&PURE_SHOT_NOISE, &mut coarse)] {
                let (class, table) = tables.choose(width).expect("a table");
                *worst = table.mismatch(width, class.block).max(*worst);
            }
        }
        let [fine, coarse] = [fine, coarse].map(|worst| worst as f32 / ONE_Q24 as f32);
        println!("off by {fine} in the fine tables, by {coarse} in the coarse ones");
        // Half a step: the square roots of 1.085 and 1.2. Beyond the widest table, a tenth of a step more.
        assert!(fine < 0.052 && coarse < 0.121, "{fine} {coarse}");
    }

    /// The quotients and u against f64: a step, and a share.
    #[test]
    fn integers_agree_with_their_definitions() {
        let (mut worst, mut worst_u) = (0.0f64, 0.0f64);
        let numbers = || (0..4000).map(|i| crate::tests::hash(3 * i) as i32 & i32::MAX);
        for (i, bits) in numbers().enumerate() {
            let value = 1 + (bits >> (i % 30));
            let slope = Slope::new(value).expect("positive");
            // Ratios of up to two.
            let product = (crate::tests::hash(3 * i + 1) as i32) >> (1 + i % 30).min(31);
            let exact = f64::from(product) / f64::from(value);
            if exact.abs() < 2.0 {
                let found = f64::from(slope.divide(product)) / f64::from(1 << 25);
                let allowed = libm::ldexp(1.5, -25) + libm::ldexp(exact.abs(), -23);
                worst = worst.max((found - exact).abs() / allowed);
            }
            let table = &GAUSSIAN.tables()[i % GAUSSIAN.tables().len()];
            // Noise of 0.06 to 2^15 counts.
            let variance = 1 + u64::from(crate::tests::hash(3 * i + 2));
            let variance = (variance << (i % 15)) >> (i % 20);
            let noise = (variance as f64 / 65536.0).sqrt();
            for block in BLOCKS {
                let per_noise = libm::ldexp(table.deviation_per_noise.into(), -13);
                let exact = noise * per_noise * f64::from(block) / f64::from(value);
                if exact < 16_000.0 {
                    let found = slope.uncertainty(variance, table, block).to_f64();
                    let allowed = libm::ldexp(0.6, -16) + libm::ldexp(exact, -19);
                    worst_u = worst_u.max((found - exact).abs() / allowed);
                }
            }
        }
        println!("{worst:.2} and {worst_u:.2} of what is allowed");
        assert!(worst < 1.0 && worst_u < 1.0);
        assert!(Slope::new(0).is_none() && Slope::new(i32::MIN).is_none());
    }

    #[test]
    fn unfit_tables_are_refused() {
        let good = generated::GAUSSIAN[12];
        assert_eq!(TableSet::new(&[good]).err(), None);
        assert_eq!(TableSet::new(&[]).err(), Some(TableError::Count));
        assert_eq!(TableSet::new(&[good, good]).err(), Some(TableError::Widths));
        let mut weights = good.weights.to_vec();
        weights[0].0.0 += 1;
        let mut stretch = good.stretch.to_vec();
        let [_, b, c] = [stretch[0], stretch[1], stretch[2]];
        (stretch[1], stretch[2]) = (Pair(30_000, -30_000), Pair(30_000, -30_000));
        stretch[0].0 += b.0 + b.1 + c.0 + c.1;
        let changed = |change: fn(&mut Table<'_>)| {
            let mut table = good;
            change(&mut table);
            TableSet::new(&[table]).err()
        };
        for (found, error) in [
            (changed(|it| it.width = 0), TableError::Widths),
            (changed(|it| it.width = i32::MAX), TableError::Widths),
            (changed(|it| it.phases = 1), TableError::Shape),
            (changed(|it| it.half_width = u8::MAX), TableError::Shape),
            (changed(|it| it.centre_per_ratio = 0), TableError::Scales),
            (changed(|it| it.deviation_per_noise = 1), TableError::Scales),
            (changed(|it| it.height_per_slope = 1), TableError::Scales),
            (changed(|it| it.stretch_per_ratio = 1), TableError::Scales),
            (changed(|it| it.per_width += 1 << 16), TableError::Scales),
            (changed(|it| it.near_limit = 2 << 26), TableError::Scales),
            (changed(|it| it.bend = i32::MIN), TableError::Scales),
        ] {
            assert_eq!(found, Some(error));
        }
        let (weights, stretch) = (&weights[..], &stretch[..]);
        let unbalanced = [Table { weights, ..good }];
        assert_eq!(TableSet::new(&unbalanced).err(), Some(TableError::Sum));
        let large = [Table { stretch, ..good }];
        assert_eq!(TableSet::new(&large).err(), Some(TableError::Overflow));
    }
}
