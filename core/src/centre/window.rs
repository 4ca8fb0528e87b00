//! A phase table's window on the row: sums pixels into samples, and weighs them by the nearest phase.

use dual_mac::{Pair, Pairs, dot, dot2};

use crate::base::Pixels;
use crate::base::numeric::limited;
use crate::centre::WidthClass;
use crate::centre::tables::{MAX_TAPS, Table, halvings};
use crate::row::Light;

/// A centre within so many pixels of a window's phase has no nearer window, if samples have several pixels.
/// Half a pixel, because such a window moves by whole pixels, and 0.05 pixel more for noise.
const NEAR: f32 = 0.55;

/// A table's window on the row.
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

/// A centre from its score and slope.
pub(super) struct Score {
    pub(super) centre: Pixels,
    /// How far it is from the window's phase, in samples.
    pub(super) distance: f32,
    /// Beyond this distance, in samples, another phase or window is nearer.
    pub(super) near_limit: f32,
    /// Whether the distance is at most `near_limit`.
    pub(super) is_near: bool,
    /// Always positive.
    pub(super) slope: f32,
    /// 1 / slope: one division serves all quotients by the slope.
    pub(super) per_slope: f32,
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
        if slope <= 0 {
            return None;
        }
        let slope = slope as f32;
        let per_slope = 1.0 / slope;
        let straight = score as f32 * per_slope * self.table.centre_per_ratio;
        let block = f32::from(self.block);
        let near_limit = if self.block == 1 {
            self.table.near_limit
        } else {
            // The window moves by pixels.
            NEAR / block
        };
        let is_near = straight.abs() <= near_limit;
        let distance = if is_near {
            // `TableSet::new` has proven that the correction is at most 5 %.
            straight * (1.0 - self.table.bend * (straight * straight))
        } else {
            self.far(straight)
        };
        // Saturates as the reference does; a distance is below 1.5 * 116 * 16 < 2^12 pixels.
        let from_reference = Pixels::from_f32(distance * block).to_bits();
        let centre = self.reference.to_bits().saturating_add(from_reference);
        Some(Score {
            centre: Pixels::from_bits(centre),
            distance,
            near_limit,
            is_near,
            slope,
            per_slope,
        })
    }

    /// The distance of a centre that is not near. Limited to one and a half widths: further off, score and
    /// bend tell only the direction.
    #[inline(never)]
    fn far(&self, straight: f32) -> f32 {
        let reach = 1.5 * self.table.width;
        let straight = limited(straight, -reach, reach);
        straight * limited(1.0 - self.table.bend * (straight * straight), 0.9, 1.1)
    }

    /// The centre, and the [stretch](Self::stretch).
    pub(super) fn score_and_stretch(&self) -> Option<(Score, f32)> {
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

    /// The spot's width over the table's, less one. Limited to a bit less than half or twice the width, like
    /// the distance.
    #[inline(always)]
    pub(super) fn stretch(&self, score: &Score) -> f32 {
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
    fn stretch_of(&self, product: i32, score: &Score) -> f32 {
        let stretch = product as f32 * score.per_slope * self.table.stretch_per_ratio;
        limited(stretch, -0.4, 0.7)
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
