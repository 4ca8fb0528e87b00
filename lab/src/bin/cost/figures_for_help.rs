//! The rungs' figures as the firmware knows them, for `help estimator`: a Rust file in the core.

use std::fmt::Write as _;

use slitrange::centre::Estimator;

use crate::report::{Measured, WINDOW_OF_96};

/// The text of `src/estimator/figures/measured.rs`. A figure that was not measured is zero.
pub fn source(measured: &Measured) -> String {
    let mut out = format!(
        "//! What each rung costs and how accurate it is. Written by `cargo cost`; not to be edited.\n\n\
         use super::{{Estimator, Figures}};\n\n\
         /// In the order of [`Estimator::ALL`].\n\
         #[rustfmt::skip]\n\
         pub const FIGURES: [Figures; {}] = [\n",
        Estimator::ALL.len()
    );
    for &estimator in &measured.estimators {
        let worst = measured.accuracy.worst(estimator);
        let instructions = measured
            .nominal(estimator)
            .map_or(0, |rung| rung.instructions);
        let tenths = measured
            .microseconds(estimator, WINDOW_OF_96)
            .map_or(0.0, |us| (us * 10.0).round());
        let _ = writeln!(
            out,
            "    Figures {{ estimator: Estimator::{estimator:?}, instructions: {instructions}, microseconds_tenths: \
             {tenths}, white_percent: {}, shot_percent: {} }},",
            percent(worst.white),
            percent(worst.shot),
        );
    }
    out + "];\n"
}

/// RMSE over the bound in percent. `as` saturates and makes zero of what is no number.
fn percent(ratio: f64) -> u16 {
    (ratio * 100.0).round() as u16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::made_up;

    #[test]
    fn a_line_a_rung() {
        let measured = made_up::measured();
        let source = source(&measured);
        println!("{source}");
        assert!(source.contains("pub const FIGURES: [Figures; 10] = [\n"));
        let lines: Vec<&str> = source
            .lines()
            .filter(|line| line.contains("Figures {"))
            .collect();
        assert_eq!(lines.len(), 10);
        // Its numbers are those of the report.
        let worst = measured.accuracy.worst(Estimator::PhaseTable);
        let rung = measured.nominal(Estimator::PhaseTable).expect("measured");
        assert_eq!(
            lines[5],
            format!(
                "    Figures {{ estimator: Estimator::PhaseTable, instructions: {}, microseconds_tenths: {:.0}, \
                 white_percent: {:.0}, shot_percent: {:.0} }},",
                rung.instructions,
                rung.cycles_estimated as f64 / 16.8,
                worst.white * 100.0,
                worst.shot * 100.0,
            )
        );
        assert_eq!(percent(f64::NAN), 0);
    }
}
