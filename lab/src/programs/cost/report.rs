//! What was measured, as JSON, as tables to read and as CSV.

mod whole_rows;

use cost_on_chip::methods::Method;
use cost_on_chip::rows::WORDS;
use cost_on_chip::whole_rows::WIDTH;
use serde::Serialize;

use crate::prelude::*;
use crate::programs::cost::accuracy::Accuracy;
use crate::programs::cost::chip::{Chip, MethodOnChip};
use crate::programs::cost::peers::Peer;
use crate::programs::cost::reading_time;
use crate::table;

/// The chip's clock in MHz.
const CLOCK_MHZ: f64 = 168.0;

/// Cycles that an instruction of a row takes on silicon: the fewest, a typical number, and the most. From the
/// times in the manual of the Cortex-M4 (ARM DDI 0439, tables 3-1 and 7-1), and five cycles for each line of
/// flash that neither cache nor prefetch holds (RM0090, section 3.5). Fewest: flash never waits. Most:
/// prefetch never helps. The rows of `whole-rows.csv` lie within, followed instruction by instruction.
const CYCLES: [f64; 3] = [1.2, 1.6, 2.9];

/// Estimated microseconds of so many instructions: the least, typical ones, and the most.
fn microseconds(instructions: u64) -> [f64; 3] {
    CYCLES.map(|cycles| instructions as f64 * cycles / CLOCK_MHZ)
}

/// The width in pixels whose window has 96 taps.
const WINDOW_OF_96: f64 = 11.3;

/// The rows of the reading that README.md shows: those of a frame with the settings of the factory.
const README_ROWS: u64 = 16;

const README: &str = "README.md";
const ACCURACY: &str = "docs/accuracy.md";

pub struct Measured {
    /// The methods, in the order of [`Method::ALL`].
    pub methods: Vec<Method>,
    pub accuracy: Accuracy,
    pub chip: Chip,
    pub distances: String,
    pub floats: String,
    pub without_fpu: String,
    /// The methods' time on this computer in nanoseconds a row.
    pub host_ns: Vec<Option<f64>>,
    pub readings: Vec<reading_time::Point>,
    pub peers: Vec<Peer>,
}

impl Measured {
    fn chip_widths(&self) -> Vec<f64> {
        let methods = self.chip.methods.iter();
        let mut widths: Vec<f64> = methods.map(|counted| counted.width).collect();
        widths.sort_by(f64::total_cmp);
        widths.dedup();
        widths
    }

    pub fn json(&self) -> serde_json::Value {
        let mut json = serde_json::json!({
            "methods": self.figures(),
            "search_again_instructions_per_pixel": self.chip.search_again_instructions_per_pixel,
            "whole_rows": self.rows_json(),
            "core_files": self.chip.core_files,
        });
        if !self.peers.is_empty() {
            json["peers"] = serde_json::json!(self.peers);
        }
        json
    }

    /// Each method's figures: the worst over the widths it is made for, and its cost with a window of 96
    /// pixels. A figure that does not apply, or that no row gave, is null.
    fn figures(&self) -> Vec<serde_json::Value> {
        let figures = |(&method, host_ns): (&Method, &Option<f64>)| {
            let worst = self.accuracy.worst(method);
            let chip = self.chip.on_chip(method, WINDOW_OF_96);
            serde_json::json!({
                "name": method.name(),
                "rmse_over_bound_max": round(worst.white.max(worst.shot)),
                "rmse_over_bound_max_white": round(worst.white),
                "rmse_over_bound_max_shot": round(worst.shot),
                "bias_max_px": worst.bias.map(round),
                "pull_min": round(worst.pull.0),
                "pull_max": round(worst.pull.1),
                // The estimator alone.
                "chip_instructions_per_row": chip.map(|chip| chip.instructions),
                "table_bytes": chip.map(|chip| chip.table_bytes),
                "code_bytes": chip.map(|chip| chip.code_bytes),
                "stack_bytes": chip.map(|chip| chip.stack_bytes),
                "host_ns_per_row": host_ns.map(round),
            })
        };
        let methods = self.methods.iter().zip(&self.host_ns);
        methods.map(figures).collect()
    }

    pub fn blocks(&self) -> Vec<(&'static str, &'static str, String)> {
        let mut blocks = vec![
            (README, "cargo cost", self.short_markdown()),
            (README, "cargo cost, whole rows", self.readme_rows()),
            (ACCURACY, "cargo cost", self.markdown()),
            (ACCURACY, "cargo cost, distances", self.distances.clone()),
            (ACCURACY, "cargo cost, float functions", self.floats.clone()),
            (
                ACCURACY,
                "cargo cost, without FPU",
                self.without_fpu.clone(),
            ),
        ];
        if !self.peers.is_empty() {
            let peers = peers_markdown(&self.peers);
            blocks.push((ACCURACY, "cargo cost --peers --write", peers));
        }
        blocks
    }

    pub fn markdown(&self) -> String {
        let [range, share, slowest, once] = self.sentences().unwrap_or_default();
        format!(
            "### Whole rows\n\n\
             A row's way from its {WORDS} words in memory to its centre with its check: instructions on the \
             emulated chip. The spot has σ {WIDTH}. *following*: a \
             row after another one of its frame. *first*: the first row of a frame. *slowest*: the slowest \
             row that we know.\n\n\
             {}\n{range} {share} {slowest} {once}\n\n\
             The steps, in instructions:\n\n{}\n\
             The same rows with spots of other widths:\n\n{}\n\
             ### The estimators' accuracy\n\n\
             On a PC, {} synthetic rows a cell; the worst over widths from 1.2 to 18 px. \
             *repair* is the robust fit that the check runs on a row that fails the check.\n\n\
             {}\n\
             ### The estimator alone\n\n\
             Only the step *estimate*, without conversion, search and check, from the second row of a frame \
             on. On the emulated chip, except *host ns*.\n\n{}\n\
             The search for the spot takes {:.2} instructions a pixel if the row before gave a width of 4 \
             pixels or more. In the first row of a frame, and for narrower spots, it takes {:.2} \
             instructions a pixel. Turning a read-out into a row takes {:.2} instructions a word.\n",
            self.rows_table(),
            self.steps_table(),
            self.widths_table(),
            self.accuracy.rows,
            self.accuracy_table(),
            self.cost_table(),
            self.chip.search_again_instructions_per_pixel,
            self.chip.search_instructions_per_pixel,
            self.chip.geometry_instructions_per_word,
        )
    }

    /// The table of README.md: what the sensor gives, and on what each figure was measured.
    fn short_markdown(&self) -> String {
        let default = Estimator::default();
        let name = default.name();
        let worst = self.accuracy.worst(Method::Estimator(default));
        let counts = (self.chip.whole_rows.kinds(default))
            .map(|row| row.map_or("-".into(), |row| row.total().to_string()));
        let mut rows = vec![
            [
                format!("RMS error of a row's centre divided by the bound, `{name}` (default)"),
                ratio(worst.white.max(worst.shot)),
                "PC, synthetic rows".into(),
            ],
            [
                format!("whole row, `{name}`: following; first; slowest"),
                format!("{} instructions", counts.join("; ")),
                "virtual board".into(),
            ],
        ];
        for (surface, light) in [
            ("no speckle", reading_time::Light::NoiseAlone),
            ("white paper", reading_time::Light::SpeckleAtRest),
        ] {
            let of_light = |point: &&reading_time::Point| {
                point.light == light && point.rows == README_ROWS && point.estimator == default
            };
            let figures = |point: &reading_time::Point| {
                let digits = if point.micrometres < 10.0 { 1 } else { 0 };
                format!(
                    "{:.digits$} um; {:.0} um; {:.1} um",
                    point.micrometres, point.u_micrometres, point.r_micrometres
                )
            };
            let point = self.readings.iter().find(of_light);
            rows.push([
                format!("distance, 0.8 m, {README_ROWS} rows, {surface}: RMS error; median u, r"),
                point.map_or("-".into(), figures),
                "PC, simulated".into(),
            ]);
        }
        let rows = rows.into_iter().map(Vec::from);
        format!(
            "{}\nA row is one read-out of the pixels. The bound (Cramér-Rao) is the smallest error of any \
             unbiased method with this noise. The ratio is the worst of spot widths (sigma) from 1.2 to 18 \
             px. A whole row: from the row's words to its centre with its check.\n",
            table::of("figure | value | measured on", rows),
        )
    }

    fn readme_rows(&self) -> String {
        let [range, share, ..] = self.sentences().unwrap_or_default();
        format!(
            "{}\nInstructions from the {WORDS} words of a row to its centre with its check. {range} {share}\n",
            self.rows_table(),
        )
    }

    fn accuracy_table(&self) -> String {
        let head = "estimator | white | shot + read | bias px | error / claim | no centre | gross";
        let rows = self.methods.iter().map(|&method| {
            let worst = self.accuracy.worst(method);
            vec![
                label(method),
                ratio(worst.white),
                ratio(worst.shot),
                (worst.bias).map_or("-".into(), |bias| format!("{bias:.5}")),
                format!("{:.2} to {:.2}", worst.pull.0, worst.pull.1),
                percent(worst.faults),
                percent(worst.gross),
            ]
        });
        table::of(head, rows)
    }

    fn cost_table(&self) -> String {
        let widths = self.chip_widths();
        let of_widths: String = widths.iter().map(|width| format!("σ {width} | ")).collect();
        let rows = self.methods.iter().zip(&self.host_ns).map(|(&method, ns)| {
            let figure = |width: f64, of: fn(&MethodOnChip) -> u64| {
                let counted = self.chip.on_chip(method, width);
                counted.map_or("-".into(), |counted| of(counted).to_string())
            };
            let mut row = vec![label(method)];
            row.extend((widths.iter()).map(|&width| figure(width, |counted| counted.instructions)));
            row.extend([
                figure(WINDOW_OF_96, |counted| counted.code_bytes),
                figure(WINDOW_OF_96, |counted| counted.table_bytes),
                figure(WINDOW_OF_96, |counted| counted.stack_bytes),
                ns.map_or("-".into(), |ns| format!("{ns:.0}")),
            ]);
            row
        });
        let head = format!("estimator | {of_widths}code B | tables B | stack B | host ns");
        table::of(&head, rows)
    }

    /// Writes the cells of the accuracy and the whole rows as CSV files into a directory.
    pub fn write_csv(&self, directory: &Path) -> anyhow::Result<()> {
        std::fs::create_dir_all(directory)?;
        let cells = self.accuracy.cells.iter().map(|cell| {
            let (it, noise) = (&cell.outcome, cell.noise);
            // Either `snr`, or the three that follow it.
            let snr = (noise.is_white()).then_some(round(noise.amplitude / noise.read_noise));
            let shot = [
                noise.electrons_per_count.map(|_| noise.amplitude),
                noise.electrons_per_count,
                noise.electrons_per_count.map(|_| noise.read_noise),
            ];
            let found = [it.rmse, it.bound, it.ratio(), it.pull].map(round);
            let counts = [self.accuracy.rows, it.faults, it.gross];
            (
                cell.method.name(),
                cell.width,
                snr,
                shot,
                counts[0],
                found,
                counts[1],
                counts[2],
            )
        });
        write_csv(
            &directory.join("accuracy.csv"),
            "method,width_px,snr,amplitude,electrons_per_count,read_noise,rows,rmse_px,bound_px,\
             rmse_over_bound,pull,faults,gross",
            cells,
        )?;
        let rows = self.chip.whole_rows.0.iter().map(|row| {
            let steps = &row.steps;
            (row.kind, row.name, row.width, steps.0, steps.total())
        });
        write_csv(
            &directory.join("whole-rows.csv"),
            "row,estimator,width_px,convert,search,estimate,check,frame,distance,other,total",
            rows,
        )
    }
}

fn write_csv(
    path: &Path,
    head: &str,
    records: impl Iterator<Item = impl Serialize>,
) -> anyhow::Result<()> {
    let mut writer = csv::WriterBuilder::new();
    let writer = writer.has_headers(false).from_path(path);
    let mut writer = writer.with_context(|| format!("writing {}", path.display()))?;
    writer.write_record(head.split(','))?;
    for record in records {
        writer.serialize(record)?;
    }
    Ok(writer.flush()?)
}

/// To five significant digits: what follows is noise, and would make a difference of every run.
fn round(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let scale = 10f64.powi(4 - value.abs().log10().floor() as i32);
    (value * scale).round() / scale
}

/// A method's name, marked where the firmware does not offer it.
fn label(method: Method) -> String {
    match method {
        Method::Estimator(estimator) => estimator.name().to_owned(),
        Method::Repair => "repair (check)".to_owned(),
    }
}

fn ratio(value: f64) -> String {
    match value {
        value if value.is_nan() => "-".into(),
        value if value >= 100.0 => format!("{value:.0}"),
        value if value >= 10.0 => format!("{value:.1}"),
        value => format!("{value:.3}"),
    }
}

fn percent(part: f64) -> String {
    match part {
        0.0 => "0".into(),
        part if part < 0.001 => "< 0.1 %".into(),
        part => format!("{:.1} %", part * 100.0),
    }
}

fn peers_markdown(peers: &[Peer]) -> String {
    let head = "peer | fit: PC time | fit: chip instructions | row: PC time | row: chip instructions \
                | RMSE / bound";
    let rows = peers.iter().map(|peer| {
        let figures = [
            Some(peer.host_time_ratio),
            peer.chip_instruction_ratio,
            Some(peer.host_row_time_ratio),
            peer.chip_row_instruction_ratio,
            Some(peer.rmse_over_bound),
        ];
        let figures = figures.map(|figure| figure.map_or("-".into(), ratio));
        [peer.name.to_owned()].into_iter().chain(figures).collect()
    });
    format!(
        "{}\n*fit*: a peer's fit over the step *estimate* of `{}`. *row*: a whole following row with the \
         peer's fit over a whole following row with `{}`.\n",
        table::of(head, rows),
        Estimator::default().name(),
        Estimator::default().name(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::programs::cost::sample_measurements;

    /// Other programs rely on these keys.
    #[test]
    fn the_json_has_the_keys_that_users_rely_on() {
        let mut measured = sample_measurements::measured();
        let json = measured.json();
        assert!(json.get("peers").is_none());
        assert!(json["search_again_instructions_per_pixel"].is_f64());
        let methods = json["methods"].as_array().expect("an array");
        assert_eq!(methods.len(), Method::ALL.len());
        for method in methods {
            assert!(method["name"].is_string());
            for key in [
                "rmse_over_bound_max",
                "bias_max_px",
                "pull_min",
                "pull_max",
                "chip_instructions_per_row",
                "table_bytes",
                "code_bytes",
                "stack_bytes",
                "host_ns_per_row",
            ] {
                assert!(method[key].is_number(), "{key} of {method}");
            }
            let [worst, white, shot] = ["", "_white", "_shot"]
                .map(|of| method[format!("rmse_over_bound_max{of}")].as_f64());
            assert_eq!(worst, white.zip(shot).map(|(white, shot)| white.max(shot)));
        }
        measured.peers = vec![Peer {
            name: "a",
            host_time_ratio: 2.0,
            chip_instruction_ratio: None,
            host_row_time_ratio: 1.1,
            chip_row_instruction_ratio: None,
            rmse_over_bound: 1.5,
        }];
        assert_eq!(
            measured.json()["peers"],
            serde_json::json!([{
                "name": "a",
                "host_time_ratio": 2.0,
                "chip_instruction_ratio": null,
                "host_row_time_ratio": 1.1,
                "chip_row_instruction_ratio": null,
                "rmse_over_bound": 1.5,
            }])
        );
    }

    #[test]
    fn the_worst_is_taken_over_the_widths_that_a_method_is_made_for() {
        let mut measured = sample_measurements::measured();
        let method = measured.methods[0];
        for cell in &mut measured.accuracy.cells {
            let known = [(0.8, 9.0), (30.0, 8.0), (1.2, 1.7), (18.0, 1.6)];
            let ratio = known.iter().find(|(width, _)| *width == cell.width);
            cell.outcome.rmse = cell.outcome.bound * ratio.map_or(1.0, |(_, ratio)| *ratio);
        }
        let worst = measured.accuracy.worst(method);
        assert!((worst.white - 1.7).abs() < 1e-12 && (worst.shot - 1.7).abs() < 1e-12);
    }

    #[test]
    fn the_csv_files_have_a_line_for_each_figure() {
        let measured = sample_measurements::measured();
        let directory = std::env::temp_dir().join(format!("slitrange-cost-{}", std::process::id()));
        measured.write_csv(&directory).expect("files");
        for (name, count, columns) in [
            ("accuracy.csv", 6 * 12 * 10, 13),
            ("whole-rows.csv", 5 * (2 * 5 + 1 + 2), 11),
        ] {
            let text = std::fs::read_to_string(directory.join(name)).expect("a file");
            assert_eq!(text.lines().count() - 1, count, "{name}");
            let mut lines = text.lines().map(|line| line.split(',').count());
            assert!(lines.all(|line| line == columns), "{name}");
        }
        std::fs::remove_dir_all(directory).expect("removed");
    }

    #[test]
    fn tables_name_every_method_and_the_readme_no_repair() {
        let measured = sample_measurements::measured();
        let (page, readme) = (measured.markdown(), measured.short_markdown());
        for method in Method::ALL {
            // The default is marked in the table of whole rows.
            let times = match method.estimator() {
                Some(estimator) if estimator != Estimator::default() => 3,
                _ => 2,
            };
            let label = format!("| {} |", label(method));
            assert_eq!(page.matches(&label).count(), times);
            let in_readme = readme.contains(&format!("`{}`", method.name()));
            assert!(!in_readme || method.estimator().is_some(), "{method:?}");
        }
        let figures = readme.lines().filter(|line| line.starts_with("| "));
        // With the head.
        assert_eq!(figures.count(), 1 + 4);
        assert!(!readme.contains("| - |"), "{readme}");
    }

    #[test]
    fn figures_are_rounded_to_five_digits() {
        let rounded = [0.012_345_678, 123_456.7].map(round);
        assert_eq!(rounded, [0.012_346, 123_460.0]);
    }
}
