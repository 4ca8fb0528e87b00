//! The catalogue of hard cases through every estimator, and random mixtures of them.

use crate::support::*;
use judges::hard_cases;
use judges::hard_cases::report::{self, Catalogue};
use judges::hard_cases::tally::Tally;
use std::collections::HashSet;
use std::sync::LazyLock;

static CATALOGUE: LazyLock<Catalogue> = LazyLock::new(Catalogue::run);

#[test]
fn the_catalogue_is_large_and_its_cases_differ() {
    let cases = hard_cases::rows();
    let names: HashSet<&str> = cases.iter().map(|case| case.name.as_str()).collect();
    let (rows, all) = (cases.len(), CATALOGUE.count());
    println!("{rows} cases of rows, {all} of all");
    assert!(cases.len() >= 150);
    assert_eq!(names.len(), cases.len());
    // Each group's cases are together.
    assert_eq!(cases.chunk_by(|a, b| a.group == b.group).count(), 12);
    for case in &cases {
        let [first, again, other] = [0, 0, 1].map(|number| case.row(number).light);
        assert_eq!(first, again, "{}", case.name);
        // Rows of one number differ; those that are all alike by nature do not.
        let is_constant = first.iter().all(|count| *count == first[0]);
        let may_be_alike = is_constant || case.name == "any words";
        assert!(may_be_alike || first != other, "{}", case.name);
    }
}

#[test]
fn every_calibration_gives_the_expected_result() {
    for (case, found) in &CATALOGUE.calibrations {
        assert!(found.is_due, "{}: {}", case.name, found.answer);
    }
}

const USED: [Estimator; 2] = [Estimator::Adaptive, Estimator::PhaseTable];

/// The repair finds the spot among bad pixels, beside a second spot, and if its top is cut off.
#[test]
fn the_repair_gives_the_expected_result() {
    let cases = hard_cases::rows();
    let due = cases.iter().filter(|case| case.repair_within.is_some());
    println!("{} cases", due.clone().count());
    assert!(due.clone().count() >= 30);
    let failures = due.filter_map(|case| Some((&case.name, case.repair_failure()?)));
    let failures: Vec<_> = failures.collect();
    assert!(failures.is_empty(), "{failures:#?}");
}

/// The snapshot lists the cases in which each estimator fails, so that a change shows as a difference. The
/// estimators that people use fail in none. No estimator gives an impossible answer, alone or in the
/// measurement.
#[test]
fn estimators_fail_only_in_the_cases_of_the_snapshot() {
    let mut text = String::new();
    for estimator in Estimator::ALL {
        let (name, failures) = (estimator.name(), CATALOGUE.failures(estimator));
        let nonsense = failures.iter().filter(|it| it.contains(": nonsense"));
        let nonsense: Vec<_> = nonsense.collect();
        assert!(nonsense.is_empty(), "{name}: {nonsense:#?}");
        let may_fail = !USED.contains(&estimator);
        assert!(may_fail || failures.is_empty(), "{name}: {failures:#?}");
        text += &format!("{name}: {}\n", failures.len());
        for failure in failures {
            text += &format!("    {failure}\n");
        }
    }
    insta::assert_snapshot!("failures", text);
}

/// Random rows: seeds that `cargo hard-cases` does not use.
const SEEDS: std::ops::Range<u64> = 1 << 40..(1 << 40) + 50_000;

/// The most events that a rate explains, of so many rows: three standard deviations of the binomial
/// distribution above its mean.
fn most(rate: f64) -> u64 {
    let mean = rate * (SEEDS.end - SEEDS.start) as f64;
    (mean + 3.0 * mean.sqrt()) as u64
}

/// Of clean rows one in 100,000 may be confidently wrong with the estimators that people use, and of rows
/// with flaws this share.
const OF_CLEAN: f64 = 1e-5;
const OF_FLAWED: f64 = 1e-3;

#[test]
fn confident_errors_are_rare() {
    let clean = Tally::over(SEEDS, mixtures::clean, &|| {});
    let flawed = Tally::over(SEEDS, mixtures::mixture, &|| {});
    println!("{}", report::random_rows_markdown(&clean, &flawed));
    for (i, estimator) in Estimator::ALL.iter().enumerate() {
        if USED.contains(estimator) {
            let [of_clean, of_flawed] =
                [&clean, &flawed].map(|tally| tally.checked[i].confident_errors);
            let name = estimator.name();
            assert!(of_clean <= most(OF_CLEAN), "{name}: {of_clean}");
            assert!(of_flawed <= most(OF_FLAWED), "{name}: {of_flawed}");
        }
    }
}
