//! The figures under `docs/figures/`.

mod accuracy_against_time;
mod accuracy_over_width;
mod bias;
mod curves;
mod labels;
mod reading_time;
mod style;

use std::path::Path;

use crate::report::Measured;

/// Draws all figures into a directory.
///
/// # Errors
/// A file cannot be written.
pub fn draw(measured: &Measured, directory: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(directory)?;
    accuracy_against_time::draw(measured, &directory.join("accuracy-against-time.svg"))?;
    accuracy_over_width::draw(measured, &directory.join("accuracy-over-width.svg"))?;
    bias::draw(measured, &directory.join("bias-over-phase.svg"))?;
    reading_time::draw(&measured.readings, &directory.join("reading-time.svg"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::made_up;
    use cost_on_chip::methods::Method;

    /// Every figure of the methods names each method. `cargo test -p lab --bin cost figures` keeps the
    /// figures, so that you can look at them.
    #[test]
    fn figures_name_every_method() {
        let directory = std::env::temp_dir().join("slitrange-made-up-figures");
        draw(&made_up::measured(), &directory).expect("figures");
        println!("{}", directory.display());
        for (name, times) in [
            ("accuracy-against-time.svg", 4),
            ("accuracy-over-width.svg", 2),
            ("bias-over-phase.svg", 1),
        ] {
            let svg = std::fs::read_to_string(directory.join(name)).expect("a figure");
            for method in Method::ALL {
                // A label alone on its line, or followed by a ratio.
                let label = |line: &&str| {
                    *line == method.name() || line.starts_with(&format!("{} ", method.name()))
                };
                let found = svg.lines().filter(label).count();
                assert_eq!(found, times, "{} in {name}", method.name());
            }
        }
    }
}
