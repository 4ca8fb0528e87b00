//! The slowest rows that are known, on the emulated chip.

use slowest_on_chip::mailbox::Question;

use crate::prelude::*;
use crate::programs::cost::chip::program::disassembly;
use crate::programs::cost::without_fpu::floats;
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

/// The project asks for the limits of the chip with an FPU. The other one has no products of 64 bits either.
#[test]
#[ignore = "builds a program for two chips; run by .ci/run"]
fn a_plain_row_takes_few_instructions() {
    for (target, most_first, most_following) in [
        ("thumbv7em-none-eabihf", 50_000, 18_000),
        (slowest::WITHOUT_FPU, 120_000, 65_000),
    ] {
        let mut chip = Chip::power_on_for(target).expect("the chip's program");
        let rows = [false, true].map(|follows| slowest::plain_row(Estimator::default(), follows));
        let counts = chip.count(&rows).expect("counts");
        chip.finish().expect("a clean run");
        println!("{target}: first {}, following {}", counts[0], counts[1]);
        assert!(counts[0] <= most_first && counts[1] <= most_following);
    }
}

/// From the words to the sum of the frame. All names of the FPU's instructions begin with V, and without an
/// FPU the compiler calls its functions for floats. Of `gauss-newton`, the test finds both.
#[test]
#[ignore = "builds a program for two chips; run by .ci/run"]
fn a_plain_row_that_follows_uses_no_float() {
    for estimator in Estimator::ALL {
        let row = slowest::plain_row(estimator, true);
        let trace = |target| {
            let chip = Chip::power_on_for(target).expect("the chip's program");
            (chip.trace(&row).expect("a trace"), chip)
        };
        let (call, chip) = trace("thumbv7em-none-eabihf");
        let executed: BTreeSet<u64> = call.steps.keys().map(|&(from, _)| from).collect();
        let text = disassembly(chip.program()).expect("the program");
        let of_fpu = text.lines().filter(|line| {
            let address = line.split_once(':').map(|(address, _)| address.trim());
            let address = address.and_then(|digits| u64::from_str_radix(digits, 16).ok());
            let name = line.split('\t').nth(1);
            name.is_some_and(|name| name.trim().starts_with('v'))
                && address.is_some_and(|address| executed.contains(&address))
        });
        let (call, chip) = trace(slowest::WITHOUT_FPU);
        let functions = slowest::attribution(chip.program(), &call).expect("functions");
        let (of_fpu, floats) = (of_fpu.count(), floats(&functions));
        let name = estimator.name();
        println!("{name}: {of_fpu} instructions of the FPU, {floats} in functions for floats");
        let uses_floats = estimator == Estimator::GaussNewton;
        assert_eq!([of_fpu > 0, floats > 0], [uses_floats; 2], "{name}");
    }
}
