//! A recording of `monitor --csv` as a figure: distance over time, histogram, Allan deviation, spectrum.

pub mod allan;
mod figure;
pub mod spectrum;

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use csv::StringRecord;
use slitrange_device::protocol::csv::Header;
use slitrange_device::settings::columns::Columns;
use statistics::median;

use crate::sensor::stream::{FrameResult, Kind};

/// A run of readings ends where the next one comes after so many times the usual interval.
const PAUSE: f64 = 3.0;
/// By the PC's clock, a shorter pause ends no run: a busy PC takes the lines late. In seconds.
const LATE: f64 = 1.0;
/// The fewest readings of a run.
const FEWEST: usize = 16;

/// Draw a recording: distance over time, histogram, Allan deviation, spectrum
///
/// Allan deviation and spectrum need readings at an even rate. They are those of the longest run without a
/// fault and without a pause.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = include_str!("plot.help.txt").trim_ascii_end())]
pub struct PlotOptions {
    /// A recording of `monitor --csv` or `replay --csv`, or lines of a sensor with `format csv`, in mm
    file: PathBuf,
    /// The figure. Without it: the recording's name with the ending .svg
    #[arg(short, long, value_name = "SVG")]
    output: Option<PathBuf>,
}

/// The readings of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// The times in seconds and the distances in millimetres.
    pub readings: Vec<(f64, f64)>,
    /// The times of the faults, in seconds. A held reading is one, too.
    pub faults: Vec<f64>,
    /// The longest run: distances in millimetres at an even rate.
    pub run: Vec<f64>,
    /// The mean interval of the longest run, in seconds.
    pub interval_s: f64,
    /// A longer interval than this is a pause, in seconds.
    pub pause_s: f64,
}

/// `plot`.
pub fn plot(options: &PlotOptions, output: &mut dyn Write) -> Result<()> {
    let Recorded {
        results,
        bad,
        has_times,
    } = read(&options.file)?;
    if let Some(first) = bad.first() {
        let count = bad.len();
        writeln!(
            output,
            "lines left out, because they are no results: {count}, from line {first} on"
        )?;
    }
    if !has_times {
        writeln!(
            output,
            "the lines have no times (`output` without `time`): a second stands for a result"
        )?;
    }
    let series = Series::of(&results).with_context(|| options.file.display().to_string())?;
    let beside = || options.file.with_extension("svg");
    let figure = options.output.clone().unwrap_or_else(beside);
    let mm: Vec<f64> = series.readings.iter().map(|(_, mm)| *mm).collect();
    let (mean, deviation) = (statistics::mean(&mm), statistics::standard_deviation(&mm));
    let curve = allan::curve(&series.run, series.interval_s);
    figure::draw(&series, &curve, &figure)?;
    let (readings, faults) = (series.readings.len(), series.faults.len());
    let rate = 1.0 / series.interval_s;
    writeln!(
        output,
        "{readings} readings, {rate:.1} a second, {faults} faults; mean {mean:.4} mm, standard deviation \
         {deviation:.4} mm"
    )?;
    let least = curve.iter().min_by(|a, b| a.1.total_cmp(&b.1));
    if let (Some((_, first)), Some((time, least))) = (curve.first(), least) {
        writeln!(
            output,
            "longest run: {} readings; Allan deviation {first:.4} mm of one reading, at least {least:.5} mm, \
             of the mean over {time:.2} s",
            series.run.len()
        )?;
    }
    Ok(writeln!(output, "drawn: {}", figure.display())?)
}

/// The results of a recording, and the numbers of the lines that are none: cut in a crash, or torn.
struct Recorded {
    results: Vec<FrameResult>,
    bad: Vec<usize>,
    has_times: bool,
}

fn read(path: &Path) -> Result<Recorded> {
    let name = path.display();
    let bytes = fs::read(path).with_context(|| format!("{name} cannot be opened"))?;
    let text = String::from_utf8_lossy(&bytes);
    let is_header = |line: &str| {
        line.starts_with("time_s,")
            || line.starts_with("row,time_us,")
            || line.ends_with("z,h,fault")
    };
    let mut lines = (1..).zip(text.lines().map(str::trim_end));
    // A logger that came later has missed the sensor's header. Its columns are then those of the factory.
    let usual = Header(Columns::default()).to_string();
    let fields = usual.split(',').count();
    let header = match text.lines().map(str::trim_end).find(|line| is_header(line)) {
        Some(header) => {
            lines.find(|(_, line)| *line == header);
            header
        }
        None if text.lines().any(|line| line.split(',').count() == fields) => &usual,
        None => bail!(
            "{name} is no recording of `slitrange monitor --csv` or `replay --csv`, and has no lines of a \
             sensor with `format csv`"
        ),
    };
    let names = StringRecord::from_iter(header.split(','));
    let mut recorded = Recorded {
        results: vec![],
        bad: vec![],
        has_times: ["time_s", "time_us", "us"]
            .iter()
            .any(|time| names.iter().any(|it| it == *time)),
    };
    for (number, line) in lines.filter(|(_, line)| *line != header) {
        let index = recorded.results.len() as f64;
        match result_of(line, &names, index) {
            Some(result) => recorded.results.push(result),
            None => recorded.bad.push(number),
        }
    }
    Ok(recorded)
}

/// Reads a line of `monitor`, of `replay` or of a sensor. A line without a time has the time `index`.
fn result_of(line: &str, names: &StringRecord, index: f64) -> Option<FrameResult> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .from_reader(line.as_bytes());
    let fields = reader.records().next()?.ok()?;
    if fields.len() != names.len() || line.contains('\0') {
        return None;
    }
    if names.get(0) == Some("time_s") {
        return fields.deserialize(Some(names)).ok();
    }
    let field = |all: &[&str]| {
        let at = names.iter().position(|name| all.contains(&name))?;
        fields.get(at).filter(|it| !it.is_empty())
    };
    let number = |all: &[&str]| field(all).map(str::parse::<f64>).transpose();
    let distance_mm = number(&["distance_mm", "distance"]).ok()?;
    let time_us = number(&["time_us", "us"]).ok()?;
    let kind = match (distance_mm, field(&["z"]), field(&["h"])) {
        (None, ..) => Kind::Fault,
        (_, _, Some(held)) if held != "0" => Kind::Held,
        (_, Some("1"), _) => Kind::Difference,
        _ => Kind::Reading,
    };
    Some(FrameResult {
        time_s: time_us.map_or(index, |us| us * 1e-6),
        kind,
        distance_mm,
        ..FrameResult::default()
    })
}

impl Series {
    /// Takes the readings of a recording. If it has none, the differences from `zero`.
    pub fn of(lines: &[FrameResult]) -> Result<Self> {
        let kind = match lines.iter().any(|line| line.kind == Kind::Reading) {
            true => Kind::Reading,
            false => Kind::Difference,
        };
        // The sensor's own clock is better than the PC's, if the lines have it.
        let has_clock = |line: &FrameResult| line.kind == Kind::Gap || line.sensor_us.is_some();
        let is_timed = lines.iter().all(has_clock) && !lines.iter().any(|it| it.kind == Kind::Gap);
        let time = |line: &FrameResult| match line.sensor_us {
            Some(us) if is_timed => us as f64 * 1e-6,
            _ => line.time_s,
        };
        // A run ends at each line that is no reading.
        let mut runs: Vec<Vec<(f64, f64)>> = vec![vec![]];
        let mut faults = Vec::new();
        for line in lines {
            match (line.distance_mm, runs.last_mut()) {
                (Some(mm), Some(run)) if line.kind == kind => run.push((time(line), mm)),
                _ => {
                    let is_fault = matches!(line.kind, Kind::Fault | Kind::Held);
                    faults.extend(is_fault.then(|| time(line)));
                    runs.push(vec![]);
                }
            }
        }
        let steps = |run: &Vec<(f64, f64)>| -> Vec<f64> {
            run.windows(2).map(|pair| pair[1].0 - pair[0].0).collect()
        };
        let intervals: Vec<f64> = runs.iter().flat_map(steps).collect();
        ensure!(
            !intervals.is_empty(),
            "there are no two readings one after the other"
        );
        let usual = PAUSE * median(&intervals);
        let pause_s = if is_timed { usual } else { usual.max(LATE) };
        let even = (runs.iter())
            .flat_map(|run| run.chunk_by(|before, after| after.0 - before.0 < pause_s));
        let longest = even.max_by_key(|run| run.len()).unwrap_or_default();
        ensure!(
            longest.len() >= FEWEST,
            "the longest run without a fault and a pause has {} readings, and {FEWEST} are needed: record \
             for longer",
            longest.len()
        );
        let (first, last) = (longest[0].0, longest[longest.len() - 1].0);
        let interval_s = (last - first) / (longest.len() - 1) as f64;
        ensure!(interval_s > 0.0, "the times do not increase");
        Ok(Self {
            run: longest.iter().map(|(_, mm)| *mm).collect(),
            readings: runs.concat(),
            faults,
            interval_s,
            pause_s,
        })
    }
}
