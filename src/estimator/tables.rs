//! The weights of the phase tables, proven, and which of them serve a spot.
//!
//! The crate `phase-tables` designs the weights and explains them; `build.rs` writes those of the gaussian.

use crate::estimator::WidthClass;
use crate::row::LARGEST_COUNT;

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
    pub(super) fn serves(&self, width: f32) -> bool {
        let largest_block = f32::from(BLOCKS[BLOCKS.len() - 1]);
        let widest = self.0.last().map_or(0.0, |table| table.width);
        (NARROWEST..widest * largest_block * WIDEST_SERVED).contains(&width)
    }

    /// The pixels in a sample and the table that match a width in pixels best, and how far they are from a match.
    pub(super) fn choose(&self, width: f32) -> Option<Match<'a>> {
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
pub(super) struct Match<'a> {
    pub(super) class: WidthClass,
    pub(super) table: &'a Table<'a>,
    /// See [`mismatch`].
    pub(super) off: f32,
}

/// How far a spot `ratio` times as wide as a table is from where the table serves best.
///
/// With single pixels the tables' widths are 1.2 apart, and a table serves from 0.95 to 1.14 of its own: with r = 0.3 the
/// standard deviation in white noise is then 1.083 to 1.02 of the bound (1.057 at the table's width), and in pure shot noise
/// 1.09 to 1.16 (1.10). Blocks can be chosen to match.
pub(super) fn mismatch(ratio: f32, block: u8) -> f32 {
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

/// No optics makes a spot narrower than this, in pixels: a hot pixel alone looks like one of 0.3.
pub(super) const NARROWEST: f32 = 0.6;

/// No table serves spots wider than this times the widest one's width in the largest blocks: 151 pixels.
const WIDEST_SERVED: f32 = 1.1;

/// How often the sum of a block is halved to fit [`LARGEST_SAMPLE`]: not at all up to 8 pixels, once up to 16.
pub(super) const fn halvings(block: u8) -> u32 {
    block.div_ceil(8).next_power_of_two().ilog2()
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
}
