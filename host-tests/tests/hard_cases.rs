//! The catalogue of hard cases, through every rung.

use std::collections::HashSet;

use host_tests::hard_cases::judge::Outcome;
use host_tests::hard_cases::{self, Group, RowCase};
use rayon::prelude::*;

fn run() -> Vec<(RowCase, Vec<Outcome>)> {
    let cases = hard_cases::rows();
    cases
        .into_par_iter()
        .map(|case| {
            let outcomes = case.run();
            (case, outcomes)
        })
        .collect()
}

#[test]
fn the_catalogue_is_large_and_tells_its_cases_apart() {
    let cases = hard_cases::rows();
    let names: HashSet<&str> = cases.iter().map(|case| case.name.as_str()).collect();
    println!("{} cases", cases.len());
    assert!(cases.len() >= 150);
    assert_eq!(names.len(), cases.len());
    for group in Group::ALL {
        assert!(cases.iter().any(|case| case.group == group), "{group:?}");
    }
    for case in &cases {
        assert_eq!(case.row(3).light, case.row(3).light, "{}", case.name);
    }
}

/// No rung gives what cannot be, whatever the row.
#[test]
fn no_answer_is_nonsense() {
    let mut nonsense = vec![];
    for (case, outcomes) in run() {
        for outcome in outcomes {
            if let Some(failure) = outcome.failure.filter(|it| it.starts_with("nonsense")) {
                nonsense.push(format!("{}: {}: {failure}", outcome.rung.name(), case.name));
            }
        }
    }
    assert!(nonsense.is_empty(), "{nonsense:#?}");
}
