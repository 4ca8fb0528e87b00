//! How many points a calibration needs, and how well their distances must be known: `cargo points`.

mod figure;

use calibration::fit::solve::{Form, Solved, solve};
use calibration::points::Point;
use calibration::positions::{STAGE_MM, even_pixels};
use figures::fit::draw as draw_fit;
use simulator::distorted_optics::{DistortedOptics, RANGE};

use crate::docs;
use crate::prelude::*;

/// Calibrates simulated sensors with few points and many, and says how far the curves are from the truth.
#[derive(Args)]
pub struct Options {
    /// Also rewrite the table and the figures of docs/calibration.md
    #[arg(long)]
    write: bool,
}

const PAGE: &str = "docs/calibration.md";

const COUNTS: [usize; 10] = [3, 4, 5, 8, 12, 20, 30, 60, 120, 200];

/// Sensors that are calibrated for each figure, each of a geometry of its own: the figures' own error is 5 %.
const SENSORS: u64 = 200;

/// Standard uncertainty of a point's centre in pixels: eight frames of 64 rows of white paper, each of 0.002.
const CENTRE: f64 = 0.0007;

/// How well distances are known: what typically has a standard uncertainty, and that uncertainty in metres.
type Means = (&'static str, f64);

const MEANS: [Means; 4] = [
    ("1 um: stage with an encoder", 1e-6),
    ("20 um: screw or caliper", 20e-6),
    ("80 um: speckle of a rough target", 80e-6),
    ("0.3 mm: ruler", 300e-6),
];

/// How far sensors are from eq. (1), in metres.
const DEPARTURES: [f64; 2] = [0.0, 300e-6];

/// The sensor whose fit is drawn.
const EXAMPLE: u64 = 6;

/// Places of the range at which a curve is compared with the truth.
const PLACES: u32 = 85;

struct Cell {
    /// Root mean square over sensors and range, in metres; none where no fit could be made.
    error: Option<f64>,
    /// Share of the sensors for which the tool took eq. (1) with residuals.
    corrected: f64,
}

pub fn main(options: &Options) -> Result<()> {
    let cells: Vec<Vec<Vec<Cell>>> = DEPARTURES
        .iter()
        .map(|&departure| {
            let of = |means: Means| COUNTS.map(|count| cell(departure, means, count)).into();
            MEANS.into_iter().map(of).collect()
        })
        .collect();
    let block = ("cargo points", table(&cells));
    docs::print_or_write("cargo points", options.write, PAGE, &[block])?;
    if !options.write {
        return Ok(());
    }
    let figures = docs::path("docs/figures");
    figure::draw(&cells, &figures.join("calibration-points.svg"))?;
    let (_, example) = solved(DEPARTURES[1], MEANS[0], 60, EXAMPLE).context("no fit")?;
    let fit = figures.join("calibration-fit.svg");
    draw_fit(&example, example.better(), None, &fit)
}

fn cell(departure: f64, means: Means, count: usize) -> Cell {
    let sensors: Vec<Option<(f64, bool)>> = (0..SENSORS)
        .into_par_iter()
        .map(|seed| calibrated(departure, means, count, seed))
        .collect();
    let fitted: Vec<(f64, bool)> = sensors.iter().flatten().copied().collect();
    let sum: f64 = fitted.iter().map(|(square, _)| square).sum();
    let corrected = fitted.iter().filter(|(_, corrected)| *corrected).count();
    Cell {
        error: (fitted.len() == sensors.len()).then(|| (sum / fitted.len() as f64).sqrt()),
        corrected: corrected as f64 / SENSORS as f64,
    }
}

fn solved(
    departure: f64,
    (_, position): Means,
    count: usize,
    seed: u64,
) -> Option<(DistortedOptics, Solved)> {
    let optics = sensor(departure, seed);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let [from, to] = [RANGE.start(), RANGE.end()].map(|metres| metres * 1e3);
    let positions = even_pixels(from, to, count, STAGE_MM).ok()?;
    let points: Vec<Point> = (positions.into_iter().zip(2..))
        .map(|(d_mm, line)| Point {
            line,
            x_px: optics.centre(d_mm * 1e-3 + position * normal()) + CENTRE * normal(),
            d_mm,
            sigma_px: Some(CENTRE),
            ..Point::default()
        })
        .collect();
    Some((optics, solve(&points, Some(position)).ok()?))
}

/// The mean square error over the range, in square metres, and whether the residuals were taken.
fn calibrated(departure: f64, means: Means, count: usize, seed: u64) -> Option<(f64, bool)> {
    let (optics, solved) = solved(departure, means, count, seed)?;
    let corrected = solved.better() == Form::Corrected;
    let curve = match &solved.corrected {
        Some((curve, _)) if corrected => curve,
        _ => &solved.plain,
    };
    let square = mean((0..PLACES).map(|place| {
        let share = f64::from(place) / f64::from(PLACES - 1);
        let distance = RANGE.start() + share * (RANGE.end() - RANGE.start());
        (curve.distance(optics.centre(distance)) - distance).powi(2)
    }));
    Some((square, corrected))
}

fn sensor(departure: f64, seed: u64) -> DistortedOptics {
    // Any departure: without one, the displacement is left out.
    let optics = DistortedOptics::unknown(seed, 300e-6).expect("a geometry");
    if departure > 0.0 {
        return optics;
    }
    with(optics, |it| (it.third, it.fifth) = (0.0, 0.0))
}

fn table(cells: &[Vec<Vec<Cell>>]) -> String {
    let mut text = format!(
        "RMS error of the fitted curve in micrometres, over 0.60 to 1.02 m. Each cell is {SENSORS} simulated \
         sensors on a PC, each with a geometry of its own, fitted as `fit` does without options. Each column \
         is for one standard uncertainty of the points' distances, and says what typically has it. In \
         brackets: the per cent of the sensors for which `fit` chose eq. (1) with residuals; no brackets: \
         none.\n"
    );
    let names = MEANS.map(|(name, _)| name).join(" | ");
    for (departure, cells) in DEPARTURES.iter().zip(cells) {
        text += &if *departure > 0.0 {
            format!(
                "\nSensors that depart from eq. (1) by up to {:.0} um, as with a lens or a bent window:\n\n",
                departure * 1e6
            )
        } else {
            "\nSensors that follow eq. (1):\n\n".to_owned()
        };
        text += &format!("| points | {names} |\n|---:|---:|---:|---:|---:|\n");
        for (row, count) in COUNTS.iter().enumerate() {
            let columns = cells.iter().map(|column| {
                let Cell { error, corrected } = column[row];
                match error.map(micrometres) {
                    Some(um) if corrected > 0.0 => format!(" | {um} ({:.0})", corrected * 100.0),
                    Some(um) => format!(" | {um}"),
                    None => " | refused".to_owned(),
                }
            });
            text += &format!("| {count}{} |\n", columns.collect::<String>());
        }
    }
    text
}

/// Two digits at least.
fn micrometres(metres: f64) -> String {
    let um = metres * 1e6;
    let digits = if um < 10.0 { 1 } else { 0 };
    format!("{um:.digits$}")
}
