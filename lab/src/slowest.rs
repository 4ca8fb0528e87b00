//! The search for the slowest row: an evolution of descriptions of rows, counted on the emulated chip.
//!
//! A description ([`Description`]) is a list of shapes. The program of `slowest-on-chip` makes the row from
//! it and counts the instructions that [`slitrange::measurement::Measurement::row`] takes. [`Search`] keeps
//! the slowest descriptions of each estimator, for first rows of a frame and for following rows, and makes
//! new ones of them: it changes shapes, exchanges them, and sets single pixels.

mod chip;
mod chips;
mod evolution;
mod report;

pub use chip::Chip;
pub use chips::Chips;
pub use evolution::{Search, Slow};
use report::words_of;
pub use report::{attribution, markdown};

use slitrange::centre::Estimator;
use slowest_on_chip::corpus;
use slowest_on_chip::description::{Description, Kind, SHAPES, Shape};
use slowest_on_chip::mailbox::Question;

/// The goal: no row takes more instructions, whatever is on it. The slowest rows that we know still do.
pub const LIMIT: u32 = 400_000;

/// A chip without an FPU: ARMv6-M, whose instructions the emulated chip has too.
pub const WITHOUT_FPU: &str = "thumbv6m-none-eabi";

/// The slowest rows that the repository knows: for each estimator a first and a following row, with the
/// instructions that the search counted.
pub fn known() -> impl Iterator<Item = Slow> {
    let both = [false, true].into_iter().zip(corpus::SLOWEST);
    both.flat_map(|(follows, rows)| {
        let slow = move |((instructions, words), estimator)| Slow {
            question: Question {
                description: Description::from_words(&words),
                estimator,
                follows,
            },
            instructions,
        };
        rows.into_iter().zip(Estimator::ALL).map(slow)
    })
}

/// A spot of 10.5 pixels on a dark row, as the first row of a frame or as a following one.
pub fn plain_row(estimator: Estimator, follows: bool) -> Question {
    let mut shapes = [Shape::default(); SHAPES];
    shapes[0] = Shape {
        kind: Kind::Spot,
        rows: 0b11,
        place: 1800 * 16 + 5,
        width: 2688,
        height: 1500,
        more: 0,
    };
    let description = Description {
        black: 100,
        noise: 600,
        seed: 7,
        shapes,
    };
    Question {
        description,
        estimator,
        follows,
    }
}

/// The words of the slowest row of an estimator, and those of the row before if it is no first row.
pub fn slowest_pair(estimator: Estimator) -> Option<(Option<Vec<u16>>, Vec<u16>)> {
    let rows = known().filter(|slow| slow.question.estimator == estimator);
    let slow = rows.max_by_key(|slow| slow.instructions)?;
    Some(words_of(&slow.question))
}
