//! The slowest rows that are known, on the emulated chip.

use slitrange::centre::Estimator;
use slowest_on_chip::description::{Description, Kind, SHAPES, Shape};
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

/// A spot of 10.5 pixels on a dark row, as the first row of a frame and as a following one. The project asks
/// for the following row's limit. At 7,500 rows a second, rows are lost if a first row takes more than its
/// limit.
#[test]
#[ignore = "builds a program for the chip; run by .ci/run"]
fn a_plain_row_takes_few_instructions() {
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
    let question = |follows| Question {
        description,
        estimator: Estimator::Adaptive,
        follows,
    };
    let mut chip = Chip::power_on().expect("the chip's program");
    let counts = chip
        .count(&[question(false), question(true)])
        .expect("counts");
    chip.finish().expect("a clean run");
    println!("first {}, following {}", counts[0], counts[1]);
    assert!(counts[0] <= 46_000 && counts[1] <= 18_000);
}
