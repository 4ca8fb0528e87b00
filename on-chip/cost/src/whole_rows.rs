//! Whole rows: what the chip's program and `cargo cost` agree on.

use slitrange::centre::Estimator;

/// Rows of a frame with the settings of the factory.
pub const FRAME: u16 = 16;

/// The width of the spot whose rows are the headline, sigma in pixels: that of the nominal sensor.
pub const WIDTH: f32 = 10.5;

/// The name of a comb's rows in the program's lines, which they have in place of an estimator's: the default
/// one measures them.
pub const COMB: &str = "comb";

/// What the program does with a row that was put into its memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Order {
    /// By which estimator.
    pub estimator: Estimator,
    /// Whether the row is the first of its frame. Otherwise it follows the latest one, by the same estimator.
    pub is_first: bool,
}

impl Order {
    /// As a word, which is not 0.
    pub fn to_word(self) -> u32 {
        let number = Estimator::ALL.iter().position(|&it| it == self.estimator);
        // There are five.
        let number = number.unwrap_or_default() as u32;
        1 + 2 * number + u32::from(self.is_first)
    }

    /// From a word.
    pub fn from_word(word: u32) -> Option<Self> {
        let bits = word.checked_sub(1)?;
        Some(Self {
            estimator: *Estimator::ALL.get(bits as usize / 2)?,
            is_first: bits % 2 == 1,
        })
    }
}
