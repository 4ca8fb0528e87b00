//! What `ambient subtract` takes away, and the noise that it costs: `cargo ambient`.

use anyhow::Result;
use clap::Parser;
use host_tests::changing_light::ambient::{DARK_ROOM, LIGHTS, noise_of_mean};
use host_tests::changing_light::range::Frames;
use lab::docs;
use lab::table::{cells, markdown};
use rayon::prelude::*;
use slitrange::ambient::AmbientMode::{Off, Subtract};

/// Measures white paper in ambient light, with and without `ambient subtract`. Takes a minute.
#[derive(Parser)]
#[command(name = "cargo ambient", bin_name = "cargo ambient")]
struct Options {
    /// Frames for each light
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(10..=1_000_000))]
    frames: u32,
    /// Also rewrite the tables of docs/ambient-light.md
    #[arg(long)]
    write: bool,
}

const PAGE: &str = "docs/ambient-light.md";

/// The marks of the page's parts.
const LIGHTS_PART: &str = "cargo ambient";
const ROWS_PART: &str = "cargo ambient, rows";

/// Rows of a frame with the laser on.
const ROWS: u16 = 16;

fn main() -> Result<()> {
    let options = Options::parse();
    let frames = options.frames as usize;
    let found: Vec<(Frames, Frames)> = (LIGHTS.par_iter())
        .map(|light| {
            (
                light.measure(Off, ROWS, frames),
                light.measure(Subtract, ROWS, frames),
            )
        })
        .collect();
    let dark = DARK_ROOM.measure(Off, ROWS, frames).rms_um;
    let mut rows = vec![cells(&[
        "ambient light",
        "`off`: RMS error, um",
        "`subtract`: RMS error, um",
        "over the dark room's",
        "computed",
        "mean r, um",
        "within 2, %",
        "flagged",
        "faults",
    ])];
    rows.extend(LIGHTS.iter().zip(&found).map(|(light, (off, subtract))| {
        let within = subtract.readings() - subtract.beyond_2;
        vec![
            light.name.to_owned(),
            format!("{:.2}", off.rms_um),
            format!("{:.2}", subtract.rms_um),
            format!("{:.2}", subtract.rms_um / dark),
            format!("{:.2}", light.computed_price(Subtract, ROWS)),
            format!("{:.2}", subtract.r_um),
            format!("{:.1}", 100.0 * within as f64 / subtract.readings() as f64),
            subtract.flagged.to_string(),
            subtract.faults.to_string(),
        ]
    }));
    let lights = format!("{frames} frames in each light.\n\n{}", markdown(&rows));
    let mut rows = vec![cells(&[
        "rows in a frame",
        "the mean's variance over that of the rows, %",
        "error of a dim spot, computed, % more",
    ])];
    rows.extend([1, 4, 16, 64].map(|rows| {
        let share = noise_of_mean(rows);
        vec![
            rows.to_string(),
            format!("{:.1}", 100.0 * share),
            format!("{:.1}", 100.0 * ((1.0 + share).sqrt() - 1.0)),
        ]
    }));
    let rows = markdown(&rows);
    println!("{lights}\n{rows}");
    if options.write {
        docs::write_block(PAGE, LIGHTS_PART, &lights)?;
        return docs::write_block(PAGE, ROWS_PART, &rows);
    }
    docs::print_hint("cargo ambient", PAGE);
    Ok(())
}
