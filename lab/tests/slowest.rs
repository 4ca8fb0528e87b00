//! The slowest rows that are known, on the emulated chip.

use lab::slowest::{self, Chip, LIMIT, Search};
use slitrange::centre::Estimator;
use slowest_on_chip::mailbox::Question;

/// The rows that `cargo slowest` found take at most so many instructions. A counted row is a row that the
/// program on the chip made from its description, as [`slowest::slowest_pair`] makes it on the PC.
#[test]
fn no_known_row_takes_more_than_the_limit() {
    let known: Vec<_> = slowest::known().collect();
    assert_eq!(known.len(), 2 * Estimator::ALL.len());
    let mut chip = Chip::power_on().expect("the chip's program");
    let questions: Vec<Question> = known.iter().map(|slow| slow.question).collect();
    let counts = chip.count(&questions).expect("counts");
    chip.finish().expect("a clean run");
    for (slow, count) in known.iter().zip(&counts) {
        let estimator = slow.question.estimator.name();
        println!("{estimator}: {count}, {} when found", slow.instructions);
    }
    let slowest = counts.into_iter().max().expect("rows");
    assert!(slowest <= LIMIT, "{slowest} instructions");
}

/// A short search, from a seed of its own. `cargo slowest` takes a million rows.
#[test]
#[ignore = "takes a minute; .ci/run runs it"]
fn a_short_search_finds_no_row_beyond_the_limit() {
    let mut chip = Chip::power_on().expect("the chip's program");
    let mut search = Search::new(2);
    let known: Vec<Question> = slowest::known().map(|slow| slow.question).collect();
    search.add(&mut chip, &known).expect("counts");
    while search.rows < 50_000 {
        search.step(&mut chip).expect("counts");
    }
    for estimator in Estimator::ALL {
        for follows in [false, true] {
            let slow = search.slowest(estimator, follows).expect("rows");
            assert!(
                slow.instructions <= LIMIT,
                "{}",
                slowest::story(&slow.question)
            );
        }
    }
}
