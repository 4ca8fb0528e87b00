//! The slowest rows that are known, on the emulated chip.

use slitrange::centre::Estimator;
use slowest_on_chip::mailbox::Question;

use crate::slowest::{self, Chip};

/// The rows that `cargo slowest` found take no more instructions than when they were found, but for one in a
/// hundred: the compiler places code in another way when other code changes. A counted row is a row that the
/// program on the chip made from its description, as [`slowest::slowest_pair`] makes it on the PC.
#[test]
#[ignore = "builds a program for the chip; run by .ci/run"]
fn no_known_row_has_become_slower() {
    let known: Vec<_> = slowest::known().collect();
    assert_eq!(known.len(), 2 * Estimator::ALL.len());
    let mut chip = Chip::power_on().expect("the chip's program");
    let questions: Vec<Question> = known.iter().map(|slow| slow.question).collect();
    let counts = chip.count(&questions).expect("counts");
    chip.finish().expect("a clean run");
    for (slow, count) in known.iter().zip(counts) {
        let estimator = slow.question.estimator.name();
        println!("{estimator}: {count}, {} when found", slow.instructions);
        assert!(count <= slow.instructions + slow.instructions / 100);
    }
}
