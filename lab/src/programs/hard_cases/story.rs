//! The story of one random row.

use std::fmt::Write as _;

use judges::hard_cases::judge::{Answer, Said, answers};
use judges::hard_cases::mixtures::{Kind, RandomRow};
use judges::hard_cases::truth::Truth;
use slitrange::centre::Estimator;

/// What the row is made of, and what every estimator says of it.
pub fn story(random_row: &RandomRow) -> String {
    let RandomRow {
        seed,
        kinds,
        recipe,
    } = random_row;
    let mut text = format!("row {seed}: ");
    if kinds.is_empty() {
        text.push_str("nothing is wrong with it\n");
    } else {
        let names = Kind::ALL.iter().filter(|(kind, _)| kinds.contains(kind));
        let names: Vec<&str> = names.map(|(_, name)| *name).collect();
        _ = writeln!(text, "{}", names.join(", "));
    }
    let shot_noise = (recipe.electrons_per_count).map_or("no shot noise".to_owned(), |it| {
        format!("{it:.1} electrons a count")
    });
    _ = writeln!(
        text,
        "sensor: {} pixels, black level {:.1} counts, read noise {:.2} counts, {shot_noise}, saturated from \
         {} counts",
        recipe.pixels, recipe.black_level, recipe.read_noise, recipe.saturation
    );
    let spot = recipe.spot.map_or("none".to_owned(), |spot| {
        let (shape, width, height) = (spot.shape, spot.width, spot.amplitude);
        format!("{shape}, width {width:.3} px, height {height:.1} counts")
    });
    _ = writeln!(text, "spot: {spot}");
    for flaw in &recipe.flaws {
        _ = writeln!(text, "flaw: {flaw}");
    }
    let row = random_row.row();
    _ = writeln!(text, "truth: {}\n", row.truth);
    for (estimator, answers) in Estimator::ALL.iter().zip(answers(&row)) {
        let [alone, taken] = [answers.alone, answers.checked].map(|it| words(row.truth, &it));
        _ = writeln!(text, "{:>14} alone: {alone}", estimator.name());
        _ = writeln!(text, "{:>14} taken: {taken}", "");
    }
    text
}

fn words(truth: Truth, answer: &Answer) -> String {
    let said = Said::of_row(truth, answer);
    match answer {
        Ok(found) => format!(
            "{:.3} +- {:.3} px, off by {:.3} px, height {}, width {:.2}{}",
            found.centre,
            found.uncertainty,
            truth.error(found.centre.to_f64()),
            found.amplitude,
            found.width,
            match (said.is_flagged(), said.is_confident_error()) {
                (true, _) => ", flagged",
                (_, true) => ", CONFIDENT ERROR",
                _ => "",
            },
        ),
        Err(fault) => format!("f {fault}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use judges::hard_cases::mixtures;

    /// The story of each kind of row has words only: no name and no brace of the program's code.
    #[test]
    fn rows_are_told_in_words() {
        print!("{}", story(&mixtures::clean(1)));
        println!("{}", story(&mixtures::mixture(2)));
        for seed in 0..200 {
            let story = story(&mixtures::mixture(seed));
            let has_code = story.contains(['{', '}']) || story.contains("Some");
            assert!(!has_code, "{story}");
            let flaws = story.lines().filter(|line| line.starts_with("flaw: "));
            assert!(flaws.count() <= 3, "{story}");
            let answers = story.lines().filter(|line| line.contains(" taken: "));
            assert_eq!(answers.count(), Estimator::ALL.len());
        }
    }
}
