//! What was measured, as JSON, as tables to read and as CSV.

mod whole_rows;

use std::path::Path;

use anyhow::Context as _;
use cost_on_chip::methods::Method;
use cost_on_chip::rows::WORDS;
use cost_on_chip::whole_rows::WIDTH;
use serde::Serialize;
use slitrange::centre::Estimator;

use whole_rows::{CombInstructions, RowInstructions};

use crate::programs::cost::accuracy::{Accuracy, Noise, SITUATIONS, Worst};
use crate::programs::cost::chip::{Chip, MethodOnChip};
use crate::programs::cost::distances::Distance;
use crate::programs::cost::float_functions::FloatFunctions;
use crate::programs::cost::peers::{Peer, Peers};
use crate::programs::cost::reading_time;
use crate::table::{self, cells};

/// The chip's clock in MHz.
const CLOCK_MHZ: f64 = 168.0;

/// Cycles that an instruction of a row takes on silicon: the fewest, a typical number, and the most. From the
/// times in the manual of the Cortex-M4 (ARM DDI 0439, tables 3-1 and 7-1), and five cycles for each line of
/// flash that neither cache nor prefetch holds (RM0090, section 3.5). Fewest: flash never waits. Most: prefetch
/// never helps. The rows of `whole-rows.csv` lie within, followed instruction by instruction.
const CYCLES: [f64; 3] = [1.2, 1.6, 2.9];

/// Estimated microseconds of so many instructions: the least, typical ones, and the most.
pub fn microseconds(instructions: u64) -> [f64; 3] {
    CYCLES.map(|cycles| instructions as f64 * cycles / CLOCK_MHZ)
}

/// The width in pixels whose window has 96 taps.
pub const WINDOW_OF_96: f64 = 11.3;

/// The width in pixels of the rows that the peers fit.
pub const PEERS_WIDTH: f64 = 10.5;

/// The rows of the reading that README.md shows: those of a frame with the settings of the factory.
const README_ROWS: u64 = 16;

/// All that was measured.
pub struct Measured {
    /// The methods, in the order of [`Method::ALL`].
    pub methods: Vec<Method>,
    /// Their accuracy.
    pub accuracy: Accuracy,
    /// Their cost on the chip.
    pub chip: Chip,
    /// The forms of a calibration.
    pub distances: Vec<Distance>,
    /// The functions of floats by each library.
    pub floats: FloatFunctions,
    /// Their time on this computer in nanoseconds a row.
    pub host_ns: Vec<Option<f64>>,
    /// The whole sensor.
    pub readings: Vec<reading_time::Point>,
    /// The peers, where they were run.
    pub peers: Option<Peers>,
}

/// A method on the chip at a width, where it found a centre there.
pub fn on_chip(chip: &Chip, method: Method, width: f64) -> Option<&MethodOnChip> {
    chip.methods.iter().find(|counted| {
        let at_width = (counted.width - width).abs() < 1e-9;
        counted.name == method.name() && at_width && counted.fault.is_none()
    })
}

/// What `--json` prints. A figure that does not apply, or that no row gave, is null.
#[derive(Serialize)]
pub struct Json {
    methods: Vec<MethodJson>,
    sweep_instructions_per_pixel: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    comb_row_instructions: Option<CombInstructions>,
    #[serde(skip_serializing_if = "Option::is_none")]
    peers: Option<Vec<Peer>>,
}

/// A method's figures: the worst over the widths it is made for, and its cost with a window of 96 pixels.
#[derive(Serialize)]
struct Figures {
    name: &'static str,
    rmse_over_bound_max: f64,
    rmse_over_bound_max_white: f64,
    rmse_over_bound_max_shot: f64,
    bias_max_px: Option<f64>,
    pull_min: f64,
    pull_max: f64,
    /// The estimator alone.
    chip_instructions_per_row: Option<u64>,
    table_bytes: Option<u64>,
    code_bytes: Option<u64>,
    stack_bytes: Option<u64>,
    host_ns_per_row: Option<f64>,
}

/// An estimator of the firmware with its whole rows, or the repair.
#[derive(Serialize)]
struct MethodJson {
    #[serde(flatten)]
    figures: Figures,
    #[serde(skip_serializing_if = "Option::is_none")]
    row_instructions: Option<RowInstructions>,
}

impl Measured {
    /// A method on the chip at a width, where it found a centre there.
    pub fn on_chip(&self, method: Method, width: f64) -> Option<&MethodOnChip> {
        on_chip(&self.chip, method, width)
    }

    /// A method on a window of 96 pixels.
    pub fn nominal(&self, method: Method) -> Option<&MethodOnChip> {
        self.on_chip(method, WINDOW_OF_96)
    }

    fn chip_widths(&self) -> Vec<f64> {
        let mut widths: Vec<f64> = self
            .chip
            .methods
            .iter()
            .map(|counted| counted.width)
            .collect();
        widths.sort_by(f64::total_cmp);
        widths.dedup();
        widths
    }

    /// The object that `--json` prints.
    pub fn json(&self) -> Json {
        Json {
            methods: self
                .methods
                .iter()
                .zip(self.figures())
                .map(|(method, figures)| MethodJson {
                    figures,
                    row_instructions: method
                        .estimator()
                        .and_then(|estimator| self.chip.whole_rows.json(estimator)),
                })
                .collect(),
            sweep_instructions_per_pixel: self.chip.sweep_instructions_per_pixel,
            comb_row_instructions: self.chip.whole_rows.comb_json(),
            peers: self.peers.as_ref().map(|peers| peers.peers.clone()),
        }
    }

    fn figures(&self) -> Vec<Figures> {
        self.methods
            .iter()
            .zip(&self.host_ns)
            .map(|(&method, &host_ns_per_row)| {
                let worst = self.accuracy.worst(method);
                let chip = self.nominal(method);
                Figures {
                    name: method.name(),
                    rmse_over_bound_max: round(worst.white.max(worst.shot)),
                    rmse_over_bound_max_white: round(worst.white),
                    rmse_over_bound_max_shot: round(worst.shot),
                    bias_max_px: worst.bias.map(round),
                    pull_min: round(worst.pull.0),
                    pull_max: round(worst.pull.1),
                    chip_instructions_per_row: chip.map(|chip| chip.instructions),
                    table_bytes: chip.map(|chip| chip.table_bytes),
                    code_bytes: chip.map(|chip| chip.code_bytes),
                    stack_bytes: chip.map(|chip| chip.stack_bytes),
                    host_ns_per_row: host_ns_per_row.map(round),
                }
            })
            .collect()
    }

    /// All that the pages show, for a terminal.
    pub fn text(&self) -> String {
        let peers = self.peers.as_ref().map(peers_markdown).unwrap_or_default();
        let [methods, distances, floats] = [
            self.markdown(),
            distances_markdown(&self.distances),
            self.floats.markdown(),
        ];
        format!("{methods}\n{distances}\n{floats}\n{peers}")
    }

    /// The tables of `docs/accuracy.md`.
    pub fn markdown(&self) -> String {
        format!(
            "### Whole rows\n\n\
             A row's way from its {WORDS} words in memory to its centre with its check: instructions on the \
             emulated chip. The spot has σ {WIDTH}. *following*: a \
             row after another one of its frame. *first*: the first row of a frame. *slowest*: the slowest \
             row that we know.\n\n\
             {}\n{} {} {} {}\n\n\
             The steps, in instructions:\n\n{}\n\
             The same rows with spots of other widths:\n\n{}\n\
             ### The estimators' accuracy\n\n\
             On a PC, {} synthetic rows a cell; the worst over widths from 1.2 to 18 px. \
             {LABELS}\n\n\
             {}\n\
             ### The estimator alone\n\n\
             Only the step *estimate*, without conversion, search and check, from the second row of a frame \
             on. On the emulated chip, except *host ns*.\n\n{}\n\
             The search for the spot takes {:.2} instructions a pixel if the row before gave a width of 4 \
             pixels or more. In the first row of a frame, and for narrower spots, it takes {:.2} \
             instructions a pixel. Turning a read-out into a row takes {:.2} instructions a word.\n",
            table::markdown(&self.rows_table()),
            self.range_text(),
            self.share_text(),
            self.slowest_text(),
            self.once_a_frame_text(),
            table::markdown(&self.steps_table()),
            table::markdown(&self.widths_table()),
            self.accuracy.rows,
            table::markdown(&self.accuracy_table()),
            table::markdown(&self.cost_table()),
            self.chip.sweep_instructions_per_pixel,
            self.chip.search_instructions_per_pixel,
            self.chip.geometry_instructions_per_word,
        )
    }

    /// The table of README.md: what the sensor gives, and on what each figure was measured.
    pub fn short_markdown(&self) -> String {
        let mut rows = vec![cells(&["figure", "value", "measured on"])];
        let default = Estimator::default();
        let worst = self.accuracy.worst(Method::Estimator(default));
        rows.push(vec![
            format!(
                "RMS error of a row's centre divided by the bound, `{}` (default)",
                default.name()
            ),
            ratio(worst.white.max(worst.shot)),
            "PC, synthetic rows".into(),
        ]);
        let counts = (self.chip.whole_rows.kinds(default))
            .map(|row| row.map_or("-".into(), |row| row.total().to_string()));
        rows.push(vec![
            format!("whole row, `{}`: following; first; slowest", default.name()),
            format!("{} instructions", counts.join("; ")),
            "virtual board".into(),
        ]);
        for (surface, light) in [
            ("no speckle", reading_time::Light::NoiseAlone),
            ("white paper", reading_time::Light::SpeckleAtRest),
        ] {
            let of_light = |point: &&reading_time::Point| {
                point.light == light && point.rows == README_ROWS && point.estimator == default
            };
            let point = self.readings.iter().find(of_light);
            rows.push(vec![
                format!("distance, 0.8 m, {README_ROWS} rows, {surface}: RMS error; median u, r"),
                point.map_or("-".into(), |point| {
                    let digits = if point.micrometres < 10.0 { 1 } else { 0 };
                    format!(
                        "{:.digits$} um; {:.0} um; {:.1} um",
                        point.micrometres, point.u_micrometres, point.r_micrometres
                    )
                }),
                "PC, simulated".into(),
            ]);
        }
        format!(
            "{}\nA row is one read-out of the pixels. The bound (Cramér-Rao) is the smallest error of any \
             unbiased method with this noise. The ratio is the worst of spot widths (sigma) from 1.2 to 18 \
             px. A whole row: from the row's words to its centre with its check.\n",
            table::markdown(&rows),
        )
    }

    /// What README.md says of the estimators.
    pub fn readme_rows(&self) -> String {
        format!(
            "{}\nInstructions from the {WORDS} words of a row to its centre with its check. {} {}\n",
            table::markdown(&self.rows_table()),
            self.range_text(),
            self.share_text(),
        )
    }

    fn accuracy_table(&self) -> Vec<Vec<String>> {
        let mut rows = vec![cells(&[
            "estimator",
            "white",
            "shot + read",
            "bias px",
            "error / claim",
            "no centre",
            "gross",
        ])];
        rows.extend(self.methods.iter().map(|&method| {
            let Worst {
                white,
                shot,
                bias,
                pull,
                faults,
                gross,
            } = self.accuracy.worst(method);
            vec![
                label(method),
                ratio(white),
                ratio(shot),
                bias.map_or("-".into(), |bias| format!("{bias:.5}")),
                format!("{:.2} to {:.2}", pull.0, pull.1),
                percent(faults),
                percent(gross),
            ]
        }));
        rows
    }

    fn cost_table(&self) -> Vec<Vec<String>> {
        let widths = self.chip_widths();
        let mut head = vec!["estimator".to_owned()];
        head.extend(widths.iter().map(|width| format!("σ {width}")));
        head.extend(cells(&["code B", "tables B", "stack B", "host ns"]));
        let mut rows = vec![head];
        for (&method, ns) in self.methods.iter().zip(&self.host_ns) {
            let mut row = vec![label(method)];
            row.extend(widths.iter().map(|&width| {
                self.on_chip(method, width)
                    .map_or("-".into(), |counted| counted.instructions.to_string())
            }));
            let nominal = self.nominal(method);
            let figure = |of: fn(&MethodOnChip) -> u64| {
                nominal.map_or("-".into(), |counted| of(counted).to_string())
            };
            row.push(figure(|counted| counted.code_bytes));
            row.push(figure(|counted| counted.table_bytes));
            row.push(figure(|counted| counted.stack_bytes));
            row.push(ns.map_or("-".into(), |ns| format!("{ns:.0}")));
            rows.push(row);
        }
        rows
    }

    /// Writes everything as CSV files into a directory.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write_csv(&self, directory: &Path) -> anyhow::Result<()> {
        std::fs::create_dir_all(directory)?;
        write_csv(&directory.join("methods.csv"), self.figures())?;
        write_csv(&directory.join("accuracy.csv"), self.cells())?;
        write_csv(&directory.join("bias.csv"), self.biases())?;
        write_csv(&directory.join("situations.csv"), self.situations())?;
        write_csv(&directory.join("whole-rows.csv"), self.row_records())?;
        write_csv(&directory.join("chip.csv"), self.on_chips())?;
        write_csv(&directory.join("reading-time.csv"), &self.readings)?;
        write_csv(&directory.join("distances.csv"), &self.distances)?;
        if let Some(peers) = &self.peers {
            write_csv(&directory.join("peers.csv"), &peers.peers)?;
        }
        Ok(())
    }

    fn cells(&self) -> impl Iterator<Item = CellRecord> {
        self.accuracy.cells.iter().map(|cell| {
            let (amplitude, electrons_per_count, read_noise) = match cell.noise {
                Noise::White { snr } => (None, None, snr),
                Noise::Shot {
                    amplitude,
                    electrons_per_count,
                    read_noise,
                } => (Some(amplitude), Some(electrons_per_count), read_noise),
            };
            CellRecord {
                method: cell.method.name(),
                width_px: cell.width,
                snr: cell.noise.is_white().then_some(read_noise),
                amplitude,
                electrons_per_count,
                read_noise: (!cell.noise.is_white()).then_some(read_noise),
                rows: self.accuracy.rows,
                rmse_px: round(cell.outcome.rmse),
                bound_px: round(cell.outcome.bound),
                rmse_over_bound: round(cell.outcome.ratio()),
                pull: round(cell.outcome.pull),
                faults: cell.outcome.faults,
                gross: cell.outcome.gross,
            }
        })
    }

    fn on_chips(&self) -> impl Iterator<Item = ChipRecord<'_>> {
        self.chip.methods.iter().map(|counted| ChipRecord {
            method: &counted.name,
            width_px: counted.width,
            instructions: counted.instructions,
            code_bytes: counted.code_bytes,
            table_bytes: counted.table_bytes,
            stack_bytes: counted.stack_bytes,
            fault: counted.fault.as_deref(),
        })
    }

    fn biases(&self) -> impl Iterator<Item = BiasRecord> {
        self.accuracy.biases.iter().map(|bias| BiasRecord {
            method: bias.method.name(),
            width_px: bias.width,
            bias_max_px: bias.pixels.map(round),
        })
    }

    fn situations(&self) -> impl Iterator<Item = SituationRecord> {
        self.accuracy.situations.iter().map(|of| {
            let situation = &SITUATIONS[of.situation];
            SituationRecord {
                situation: situation.name,
                method: of.method.name(),
                row_instructions: self.row_instructions(of.method, situation.chip_width),
                rmse_px: round(of.outcome.rmse),
                rmse_over_bound: round(of.outcome.ratio()),
                faults: of.outcome.faults,
            }
        })
    }
}

/// The table of a calibration's forms for `docs/accuracy.md`.
pub fn distances_markdown(distances: &[Distance]) -> String {
    let mut rows = vec![cells(&[
        "form",
        "knots",
        "error um",
        "instructions",
        "most",
        "RAM B",
        "record B",
    ])];
    rows.extend(distances.iter().map(|distance| {
        vec![
            distance.form.to_owned(),
            distance.knots.to_string(),
            format!("{:.4}", distance.error_max_um),
            distance.instructions.to_string(),
            distance.instructions_most.to_string(),
            distance.ram_bytes.to_string(),
            distance.record_bytes.to_string(),
        ]
    }));
    table::markdown(&rows)
}

/// A line of `accuracy.csv`: either `snr`, or the three that follow it.
#[derive(Serialize)]
struct CellRecord {
    method: &'static str,
    width_px: f64,
    snr: Option<f64>,
    amplitude: Option<f64>,
    electrons_per_count: Option<f64>,
    read_noise: Option<f64>,
    rows: u64,
    rmse_px: f64,
    bound_px: f64,
    rmse_over_bound: f64,
    pull: f64,
    faults: u64,
    gross: u64,
}

#[derive(Serialize)]
struct ChipRecord<'a> {
    method: &'a str,
    width_px: f64,
    instructions: u64,
    code_bytes: u64,
    table_bytes: u64,
    stack_bytes: u64,
    fault: Option<&'a str>,
}

#[derive(Serialize)]
struct BiasRecord {
    method: &'static str,
    width_px: f64,
    bias_max_px: Option<f64>,
}

#[derive(Serialize)]
struct SituationRecord {
    situation: &'static str,
    method: &'static str,
    row_instructions: Option<u64>,
    rmse_px: f64,
    rmse_over_bound: f64,
    faults: u64,
}

fn write_csv<T: Serialize>(
    path: &Path,
    records: impl IntoIterator<Item = T>,
) -> anyhow::Result<()> {
    let mut writer =
        csv::Writer::from_path(path).with_context(|| format!("writing {}", path.display()))?;
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

/// What the marks of [`label`] mean.
const LABELS: &str =
    "*repair* is the robust fit that the check runs on a row that fails the check.";

/// A ratio, with fewer digits where it is large.
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

/// The table of the peers for `docs/accuracy.md`.
pub fn peers_markdown(peers: &Peers) -> String {
    let figure = |value: Option<f64>| value.map_or("-".into(), ratio);
    let mut rows = vec![cells(&[
        "peer",
        "fit: PC time",
        "fit: chip instructions",
        "row: PC time",
        "row: chip instructions",
        "RMSE / bound",
    ])];
    rows.extend(peers.peers.iter().map(|peer| {
        let figures = [
            peer.host_time_ratio,
            peer.chip_instruction_ratio,
            peer.host_row_time_ratio,
            peer.chip_row_instruction_ratio,
            peer.rmse_over_bound,
        ];
        let mut row = vec![peer.name.clone()];
        row.extend(figures.map(figure));
        row
    }));
    format!(
        "{}\n*fit*: a peer's fit over the step *estimate* of `{}`. *row*: a whole following row with the \
         peer's fit over a whole following row with `{}`.\n",
        table::markdown(&rows),
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
        let measured = sample_measurements::measured();
        let json = serde_json::to_value(measured.json()).expect("JSON");
        assert!(json.get("peers").is_none());
        assert!(json["sweep_instructions_per_pixel"].is_f64());
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
            let worst = |key: &str| method[key].as_f64().expect("a number");
            assert_eq!(
                worst("rmse_over_bound_max"),
                worst("rmse_over_bound_max_white").max(worst("rmse_over_bound_max_shot"))
            );
        }
        let peer = Peer {
            name: "a".into(),
            host_time_ratio: Some(2.0),
            chip_instruction_ratio: None,
            host_row_time_ratio: Some(1.1),
            chip_row_instruction_ratio: None,
            rmse_over_bound: Some(1.5),
        };
        let json = serde_json::to_value(Json {
            peers: Some(vec![peer]),
            ..measured.json()
        });
        assert_eq!(
            json.expect("JSON")["peers"],
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
        let lines = |name: &str| {
            let text = std::fs::read_to_string(directory.join(name)).expect("a file");
            (
                text.lines().next().unwrap_or_default().to_owned(),
                text.lines().count() - 1,
            )
        };
        assert_eq!(
            lines("accuracy.csv"),
            (
                "method,width_px,snr,amplitude,electrons_per_count,read_noise,rows,rmse_px,bound_px,\
                 rmse_over_bound,pull,faults,gross"
                    .to_owned(),
                6 * 12 * 10
            )
        );
        assert_eq!(lines("methods.csv").1, 6);
        assert_eq!(lines("bias.csv").1, 6 * 12);
        assert_eq!(lines("situations.csv").1, 6 * SITUATIONS.len());
        assert_eq!(lines("reading-time.csv").1, 5 * 5 * 7);
        assert_eq!(lines("whole-rows.csv").1, 5 * (2 * 5 + 1 + 2));
        assert_eq!(lines("distances.csv").1, 1);
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
            assert_eq!(
                page.matches(&format!("| {} |", label(method))).count(),
                times
            );
            if method.estimator().is_none() {
                assert!(
                    !readme.contains(&format!("`{}`", method.name())),
                    "{method:?}"
                );
            }
        }
        let figures = readme.lines().filter(|line| line.starts_with("| "));
        // With the head.
        assert_eq!(figures.count(), 1 + 4);
        assert!(!readme.contains("| - |"), "{readme}");
    }

    #[test]
    fn figures_are_rounded_to_five_digits() {
        assert_eq!(
            (round(0.012_345_678), round(123_456.7)),
            (0.012_346, 123_460.0)
        );
    }
}
