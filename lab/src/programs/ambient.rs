//! What `ambient subtract` takes away, and the noise that it costs: `cargo ambient`.

use judges::changing_light::ambient::{CHARGE_STAYS, DARK_ROOM, LIGHTS, Light, noise_of_mean};
use judges::changing_light::range::Frames;
use slitrange::light::ambient::AmbientMode::{Off, Subtract};

use crate::docs;
use crate::prelude::*;
use crate::table;

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

/// Rows of a frame with the laser on.
const ROWS: u16 = 16;

pub fn main(options: &Options) -> Result<()> {
    let frames = options.frames as usize;
    let found = LIGHTS.par_iter().map(|light| measure(light, ROWS, frames));
    let found: Vec<[Frames; 2]> = found.collect();
    let dark = DARK_ROOM.measure(Off, ROWS, frames).rms_um;
    let rows = LIGHTS.iter().zip(&found).map(|(light, found)| {
        let [off, subtract] = found;
        vec![
            light.name.to_owned(),
            format!("{:.2}", off.rms_um),
            format!("{:.2}", subtract.rms_um),
            format!("{:.2}", subtract.rms_um / dark),
            format!("{:.2}", light.computed_price(Subtract, ROWS)),
            format!("{:.2}", subtract.r_um),
            within_2(subtract),
            subtract.flagged.to_string(),
            subtract.faults.to_string(),
        ]
    });
    let head = "ambient light | `off`: RMS error, um | `subtract`: RMS error, um | over the dark room's \
                | computed | mean r, um | within 2, % | flagged | faults";
    let lights = table::of(head, rows);
    let lights = format!("{frames} frames in each light.\n\n{lights}");
    let rows = [1, 4, 16, 64].map(|rows| {
        let share = noise_of_mean(rows);
        vec![
            rows.to_string(),
            format!("{:.1}", 100.0 * share),
            format!("{:.1}", 100.0 * ((1.0 + share).sqrt() - 1.0)),
        ]
    });
    let head = "rows in a frame | the mean's variance over that of the rows, % | error of a dim spot, \
                computed, % more";
    let rows = table::of(head, rows);
    let lamps = short_frames(frames);
    let charge = measure(&CHARGE_STAYS, ROWS, frames);
    let charge = cells_of(CHARGE_STAYS.name, ROWS, &charge, dark);
    let charge = table::of(HEAD, [charge]);
    let blocks = [
        ("cargo ambient", lights),
        ("cargo ambient, rows", rows),
        ("cargo ambient, lamps", lamps),
        ("cargo ambient, charge", charge),
    ];
    docs::print_or_write("cargo ambient", options.write, PAGE, &blocks)
}

/// Frames of so many rows, without and with the subtraction.
fn measure(light: &Light, rows: u16, frames: usize) -> [Frames; 2] {
    [Off, Subtract].map(|ambient| light.measure(ambient, rows, frames))
}

/// The head of a table of frames of different lengths.
const HEAD: &str = "ambient light | rows | `off`: RMS error, um | `subtract`: RMS error, um \
                    | over the dark room's | mean r, um | within 2, % | flagged and faults";

fn within_2(frames: &Frames) -> String {
    let within = frames.readings() - frames.beyond_2;
    format!("{:.1}", 100.0 * within as f64 / frames.readings() as f64)
}

/// A line of a table with [`HEAD`]. `dark` is the RMS error in the dark room with `ambient off`.
fn cells_of(name: &str, rows: u16, [off, subtract]: &[Frames; 2], dark: f64) -> Vec<String> {
    vec![
        name.to_owned(),
        rows.to_string(),
        format!("{:.2}", off.rms_um),
        format!("{:.2}", subtract.rms_um),
        format!("{:.2}", subtract.rms_um / dark),
        format!("{:.2}", subtract.r_um),
        within_2(subtract),
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
            cells_of(light.name, rows, &measure(light, rows, frames), dark)
        })
        .collect();
    table::of(HEAD, lines)
}
