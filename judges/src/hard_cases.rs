//! Rows, frames and calibrations that are hard: what a sensor can deliver when something is wrong, and what
//! must come out then.
//!
//! A [`RowCase`] makes seeded rows from a [`Recipe`], a spot with flaws, or from a pattern of counts. Its
//! [`Truth`] is where a perfect reader would say that the spot is; its [`Due`] is what the measurement owes
//! for it, whichever estimator is chosen. [`rows`] is the catalogue. [`mixtures`] draws flaws at random, and
//! [`tally`] counts what comes of them.

pub mod calibrations;
mod catalogue;
pub mod flaw;
pub mod frames;
pub mod judge;
pub mod mixtures;
mod patterns;
pub mod recipe;
pub mod report;
pub mod shape;
pub mod tally;
pub mod truth;

pub use catalogue::rows;
pub use flaw::Flaw;
pub use recipe::{HardRow, Recipe};
pub use shape::Shape;
use simulator::scene::Sensor;
use slitrange::row::Geometry;
pub use truth::Truth;

/// What the measurement owes for a row, whichever estimator is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Due {
    /// A centre, mostly without a flag, that is off by no more than this many pixels. The estimators whose
    /// error is larger by their nature owe [`Due::Honest`].
    Centre(f64),
    /// A centre as good as it claims, or a flag, or a fault: no confident error.
    Honest,
    /// Nothing: it is shown, because neither a row nor a frame can know.
    Unknowable,
    /// A fault or a flag: no centre without one.
    NoCentre,
    /// A fault of one of these kinds ([`slitrange::base::fault::Fault::name`]).
    Fault(&'static [&'static str]),
}

/// Rows that are hard in one way.
#[derive(Clone, Debug)]
pub struct RowCase {
    /// What it is, in a few words. No two cases have the same.
    pub name: String,
    /// The heading of its group: what kind of difficulty it is.
    pub group: &'static str,
    /// Why it is hard.
    pub why: &'static str,
    /// What must come out.
    pub due: Due,
    /// Pixels within which the repair's own centres must lie, without a flag, in most rows.
    pub repair_within: Option<f64>,
    /// What the rows are made of.
    pub source: Source,
}

/// What rows are made of.
#[derive(Clone, Debug)]
pub enum Source {
    /// A spot, its noise, and its flaws.
    Recipe(Recipe),
    /// Counts of the row of a number, which have no noise of a sensor.
    Pattern(fn(u64) -> Vec<u16>),
}

impl From<Recipe> for Source {
    fn from(recipe: Recipe) -> Self {
        Self::Recipe(recipe)
    }
}

/// Rows of each case in the table.
pub const ROWS: u64 = 8;

impl RowCase {
    /// A row. Rows differ in their noise, and in where the spot is, to a fraction of a pixel.
    pub fn row(&self, number: u64) -> HardRow {
        match &self.source {
            Source::Recipe(recipe) => recipe.row(self.seed(), number),
            Source::Pattern(counts) => {
                let light = counts(number);
                HardRow {
                    geometry: Geometry {
                        shot_variance_per_count_q16: 13107,
                        ..Sensor::Row(light.len()).geometry()
                    },
                    light,
                    truth: Truth::None,
                }
            }
        }
    }

    /// Of its name, so that a case more changes no other (FNV-1a: G. Fowler, L. C. Noll, K.-P. Vo).
    fn seed(&self) -> u64 {
        self.name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3)
        })
    }
}
