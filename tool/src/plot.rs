//! A recording of `monitor --csv` as a figure: distance over time, histogram, Allan deviation, spectrum.

pub mod allan;
mod figure;
pub mod spectrum;

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
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
#[command(after_help = "\
Example:
  slitrange monitor --csv run.csv --seconds 600
  slitrange plot run.csv")]
pub struct PlotOptions {
    /// A recording of `slitrange monitor --csv`
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
    let lines = read(&options.file)?;
    let series = Series::of(&lines).with_context(|| options.file.display().to_string())?;
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

fn read(path: &Path) -> Result<Vec<FrameResult>> {
    let name = path.display();
    let file = File::open(path).with_context(|| format!("{name} cannot be opened"))?;
    let lines: Result<_, csv::Error> = csv::Reader::from_reader(file).into_deserialize().collect();
    lines.with_context(|| format!("{name} is no recording of `slitrange monitor --csv`"))
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
