//! What `ambient subtract` takes away, and the noise that it costs: `cargo ambient`.

use anyhow::Result;
use clap::Args;
use judges::changing_light::ambient::{CHARGE_STAYS, DARK_ROOM, LIGHTS, Light, noise_of_mean};
use judges::changing_light::range::Frames;
use rayon::prelude::*;
use slitrange::light::ambient::AmbientMode::{Off, Subtract};

use crate::docs;
use crate::table::{cells, markdown};

/// Measures white paper in ambient light, with and without `ambient subtract`. Takes a minute.
#[derive(Args)]
pub struct Options {
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
const LAMPS_PART: &str = "cargo ambient, lamps";
const CHARGE_PART: &str = "cargo ambient, charge";

/// Rows of a frame with the laser on.
const ROWS: u16 = 16;

/// Runs the program.
///
/// # Errors
/// A measurement fails, or a file cannot be read or written.
pub fn main(options: &Options) -> Result<()> {
    let frames = options.frames as usize;
    let measure = |light: &Light, rows| {
        (
            light.measure(Off, rows, frames),
            light.measure(Subtract, rows, frames),
        )
    };
    let found: Vec<(Frames, Frames)> = (LIGHTS.par_iter())
        .map(|light| measure(light, ROWS))
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
    let lamps = short_frames(frames);
    let charge = markdown(&[
        cells(&HEAD),
        cells_of(CHARGE_STAYS.name, ROWS, &measure(&CHARGE_STAYS, ROWS), dark),
    ]);
    println!("{lights}\n{rows}\n{lamps}\n{charge}");
    if options.write {
        docs::write_block(PAGE, LIGHTS_PART, &lights)?;
        docs::write_block(PAGE, ROWS_PART, &rows)?;
        docs::write_block(PAGE, LAMPS_PART, &lamps)?;
        return docs::write_block(PAGE, CHARGE_PART, &charge);
    }
    docs::print_hint("cargo ambient", PAGE);
    Ok(())
}

/// The head of a table of frames of different lengths.
const HEAD: [&str; 8] = [
    "ambient light",
    "rows",
    "`off`: RMS error, um",
    "`subtract`: RMS error, um",
    "over the dark room's",
    "mean r, um",
    "within 2, %",
    "flagged and faults",
];

/// A line of a table with [`HEAD`]. `dark` is the RMS error in the dark room with `ambient off`.
fn cells_of(name: &str, rows: u16, (off, subtract): &(Frames, Frames), dark: f64) -> Vec<String> {
    let within = subtract.readings() - subtract.beyond_2;
    vec![
        name.to_owned(),
        rows.to_string(),
        format!("{:.2}", off.rms_um),
        format!("{:.2}", subtract.rms_um),
        format!("{:.2}", subtract.rms_um / dark),
        format!("{:.2}", subtract.r_um),
        format!("{:.1}", 100.0 * within as f64 / subtract.readings() as f64),
        (subtract.flagged + subtract.faults).to_string(),
    ]
}

/// Frames of few rows under lamps, beside the window, which is as bright and does not flicker.
fn short_frames(frames: usize) -> String {
    let all: Vec<(u16, &Light)> = [1, 4, ROWS]
        .into_iter()
        .flat_map(|rows| LIGHTS[1..].iter().map(move |light| (rows, light)))
        .filter(|(_, light)| light.name == "beside a window" || light.name.starts_with("lamps"))
        .collect();
    let lines: Vec<Vec<String>> = (all.par_iter())
        .map(|&(rows, light)| {
            let dark = DARK_ROOM.measure(Off, rows, frames).rms_um;
            let found = (
                light.measure(Off, rows, frames),
                light.measure(Subtract, rows, frames),
            );
            cells_of(light.name, rows, &found, dark)
        })
        .collect();
    markdown(&[vec![cells(&HEAD)], lines].concat())
}
