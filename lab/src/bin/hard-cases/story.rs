//! The story of one random row.

use host_tests::hard_cases::judge::{Answer, Said, answers};
use host_tests::hard_cases::mixtures::RandomRow;
use host_tests::hard_cases::truth::Truth;
use slitrange::centre::Estimator;

/// Prints what the row is made of, and what every estimator says of it.
pub fn tell(random_row: &RandomRow) {
    println!("{random_row:#?}");
    let row = random_row.row();
    println!("truth: {:?}", row.truth);
    for (estimator, answers) in Estimator::ALL.iter().zip(answers(&row)) {
        println!(
            "{:>14} alone: {}",
            estimator.name(),
            words(row.truth, &answers.alone)
        );
        println!("{:>14} taken: {}", "", words(row.truth, &answers.checked));
    }
}

fn words(truth: Truth, answer: &Answer) -> String {
    let said = Said::of_row(truth, answer);
    match answer {
        Ok(found) => format!(
            "{:.3} +- {:.3} px, off by {:.3} px, height {}, width {:.2}{}{}",
            found.centre,
            found.uncertainty,
            truth.error(found.centre.to_f64()),
            found.amplitude,
            found.width,
            if said.is_flagged() { ", flagged" } else { "" },
            if said.is_confident_error() {
                ", CONFIDENT ERROR"
            } else {
                ""
            },
        ),
        Err(fault) => format!("{fault:?}"),
    }
}
