//! The figures under `docs/figures/`.

mod accuracy_against_time;
mod accuracy_over_width;
mod bias;
mod curves;
mod reading_time;
mod row_steps;
mod style;

use std::path::Path;

use crate::programs::cost::report::Measured;

pub fn draw(measured: &Measured, directory: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(directory)?;
    accuracy_against_time::draw(measured, &directory.join("accuracy-against-time.svg"))?;
    accuracy_over_width::draw(measured, &directory.join("accuracy-over-width.svg"))?;
    bias::draw(measured, &directory.join("bias-over-phase.svg"))?;
    row_steps::draw(measured, &directory.join("row-steps.svg"))?;
    reading_time::draw(measured, &directory.join("reading-time.svg"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::programs::cost::sample_measurements;
    use cost_on_chip::methods::Method;
    use slitrange::centre::Estimator;

    /// Every figure of the methods names each method. `cargo test cost::figures` keeps the
    /// figures, so that you can look at them.
    #[test]
    fn figures_name_every_method() {
        let directory = std::env::temp_dir().join("slitrange-made-up-figures");
        draw(&sample_measurements::measured(), &directory).expect("figures");
        println!("{}", directory.display());
        for (name, times) in [
            ("accuracy-against-time.svg", 4),
            ("accuracy-over-width.svg", 2),
            ("bias-over-phase.svg", 1),
        ] {
            let svg = std::fs::read_to_string(directory.join(name)).expect("a figure");
            for method in Method::ALL {
                // A label alone on its line, or followed by a ratio.
                let method = method.name();
                let label = |line: &&str| line.split(' ').next() == Some(method);
                let found = svg.lines().filter(label).count();
                assert_eq!(found, times, "{method} in {name}");
            }
        }
    }

    /// The five steps and the estimators are named, with a total for each of three rows.
    #[test]
    fn the_bars_name_every_step_and_estimator() {
        let path = std::env::temp_dir().join("slitrange-made-up-row-steps.svg");
        let measured = sample_measurements::measured();
        row_steps::draw(&measured, &path).expect("a figure");
        let svg = std::fs::read_to_string(&path).expect("a figure");
        let lines = |text: &str| svg.lines().filter(|line| *line == text).count();
        for step in ["convert", "search", "estimate", "check", "frame"] {
            assert_eq!(lines(step), 1, "{step}");
        }
        for estimator in Estimator::ALL {
            assert_eq!(lines(estimator.name()), 3, "{estimator:?}");
            let rows = measured.chip.whole_rows.kinds(estimator);
            for row in rows.into_iter().flatten() {
                assert!(lines(&row.total().to_string()) >= 1, "{estimator:?}");
            }
        }
    }
}
