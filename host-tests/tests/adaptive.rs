//! The adaptive rung against the Cramér-Rao bound, with knowledge of the row before and without. Every figure asserted is printed.

use host_tests::accuracy::Cell;
use host_tests::grid::{Before, Rows};
use slitrange::estimator::Estimator;

const WIDTHS: [f64; 10] = [1.2, 1.58, 2.0, 3.0, 4.61, 6.72, 8.0, 10.5, 13.4, 18.0];

/// Rows of a cell, with the row before and again without.
const ROWS: u64 = 20_000;

/// White noise: at most 1.03 of the bound.
#[test]
fn white_noise_is_within_three_per_cent_of_the_bound() {
    let mut table = Table::new("white noise", "SNR");
    for snr in [25.0, 100.0, 500.0, 1800.0] {
        table.row(&snr.to_string(), 1.03, |width| Cell {
            width,
            amplitude: 2400.0,
            read_noise: 2400.0 / snr,
            electrons_per_count: None,
            rows: ROWS,
            seed: snr as u64,
        });
    }
    table.check("white_noise");
}

/// Shot and read noise: at most 1.04 of the bound. The worst is the first, whose r of 0.8 lies furthest from those that there are
/// tables for.
#[test]
fn shot_noise_is_within_four_per_cent_of_the_bound() {
    let mut table = Table::new("shot and read noise", "counts, e/count, read");
    for (amplitude, electrons, read_noise) in [
        (100.0, 5.0, 4.0),
        (1000.0, 5.0, 2.0),
        (1000.0, 2.0, 8.0),
        (3800.0, 10.0, 1.0),
        (3800.0, 10.0, 8.0),
        (3800.0, 2.0, 2.0),
    ] {
        let name = format!("{amplitude}, {electrons}, {read_noise}");
        table.row(&name, 1.04, |width| Cell {
            width,
            amplitude,
            read_noise,
            electrons_per_count: Some(electrons),
            rows: ROWS,
            seed: (amplitude / electrons) as u64,
        });
    }
    table.check("shot_noise");
}

/// Ratios and pulls over [`WIDTHS`]: printed, asserted, and kept as a snapshot, so that a change shows.
struct Table {
    text: String,
    failures: Vec<String>,
}

impl Table {
    fn new(title: &str, left: &str) -> Self {
        let widths = WIDTHS.map(|width| format!("{width:>12}")).concat();
        Self {
            text: format!(
                "RMSE / bound (pull) of the adaptive rung in {title}, {ROWS} rows a cell; sigma in pixels\n{left:>22}{:>11}{widths}\n",
                ""
            ),
            failures: vec![],
        }
    }

    /// Runs a row of cells. Each must have a centre in every row of pixels, stay within `limit` times the bound and claim
    /// its uncertainty to 5 %.
    fn row(&mut self, name: &str, limit: f64, cell: impl Fn(f64) -> Cell) {
        let outcomes = WIDTHS.map(|width| {
            let cell = cell(width);
            let rows = Rows {
                pixels: cell.pixels(),
                ..Rows::of(cell)
            };
            rows.run_each(
                &[Before::Known, Before::Unknown].map(|before| (Estimator::Adaptive, before)),
            )
        });
        for (i, how) in ["in series", "alone"].into_iter().enumerate() {
            self.text += &format!("{name:>22}{how:>11}");
            for (width, outcomes) in WIDTHS.into_iter().zip(&outcomes) {
                let outcome = outcomes[i];
                self.text += &format!("{:>6.2} ({:.2})", outcome.ratio(), outcome.pull);
                let good = (outcome.faults, outcome.gross) == (0, 0)
                    && outcome.ratio() <= limit
                    && (0.95..=1.05).contains(&outcome.pull);
                if !good {
                    self.failures.push(format!(
                        "{name}, {how}, sigma {width}, at most {limit}: {outcome:?}"
                    ));
                }
            }
            self.text += "\n";
        }
    }

    fn check(&self, name: &str) {
        println!("{}", self.text);
        assert!(self.failures.is_empty(), "{}", self.failures.join("\n"));
        insta::assert_snapshot!(name, self.text);
    }
}
