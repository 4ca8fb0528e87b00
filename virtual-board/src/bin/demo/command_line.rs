//! The command line, and what the demo prints.

use std::path::PathBuf;

use clap::Parser;

/// Builds the firmware, boots it on an emulated NUCLEO-F429ZI with sensor, laser and target, and shows what
/// it reports.
#[derive(Parser)]
#[command(name = "cargo demo", bin_name = "cargo demo")]
pub struct Options {
    /// Keep the target at this distance in millimetres, instead of moving it from 600 to 1020
    // The parser makes metres of them.
    #[arg(long, value_name = "MM", value_parser = metres)]
    pub distance: Option<f64>,
    /// Rows in a frame.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u16).range(1..=64))]
    pub rows: u16,
    /// Distances to measure at, from 600 to 1020 mm [default: 43; with --scene only the scene's]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub steps: Option<u32>,
    /// Show the sensor this scene instead of white paper: a name that `cargo scene` lists, or the path of a
    /// .toml file. The firmware's exposure replaces the scene's.
    #[arg(long, value_name = "NAME")]
    pub scene: Option<String>,
    /// Send the firmware this line before it measures, as "exposure 5600" or "ambient subtract". May be
    /// given several times.
    #[arg(long, value_name = "LINE", conflicts_with = "pgm")]
    pub set: Vec<String>,
    /// Put a comb of 16 slits before the sensor, instead of one slit, and tell the firmware `slits comb`. A
    /// scene that has a comb keeps its own, with or without this option.
    #[arg(long)]
    pub comb: bool,
    /// Show the sensor the rows of a photograph (binary PGM, 8 or 16 bit), one after the other.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["distance", "steps", "scene", "comb", "pty"])]
    pub pgm: Option<PathBuf>,
    /// Open the serial line as a pseudo-terminal for tio or screen, and run on wall time until interrupted.
    #[arg(long, conflicts_with_all = ["json", "steps"])]
    pub pty: bool,
    /// Put the target at the distance in FILE, in millimetres. The demo reads FILE again whenever it changes.
    /// To try calibrating without hardware, use the stage command `echo {} > FILE`. The word `covered` in
    /// FILE, in place of a distance, keeps all light from the sensor.
    #[arg(long, value_name = "FILE", requires = "pty")]
    pub stage: Option<PathBuf>,
    /// Give the sensor an unknown geometry, so that it needs a calibration: distances are off by millimetres
    /// to centimetres, and depart from eq. (1) by 0.3 mm. Each SEED is another geometry. For white paper
    /// only.
    #[arg(long, value_name = "SEED", requires = "pty", conflicts_with = "scene")]
    pub unknown_geometry: Option<u64>,
    /// Keep the sensor's flash in FILE. If you start the demo again with the same FILE, this is a power
    /// cycle.
    #[arg(long, value_name = "FILE", requires = "pty")]
    pub flash: Option<PathBuf>,
    /// Print the summary as one JSON object on standard output, and everything else on standard error.
    #[arg(long)]
    pub json: bool,
}

/// The metres of a distance that a person types in millimetres, as everywhere.
fn metres(text: &str) -> Result<f64, String> {
    let millimetres = text.parse().ok();
    (millimetres.filter(|mm: &f64| (10.0..=8380.0).contains(mm)))
        .map(|mm| 1e-3 * mm)
        .ok_or_else(|| "it must be 10 to 8380 millimetres (800, not 0.8)".into())
}

/// Prints the table: on standard error if standard output is for JSON.
pub fn say(json: bool, text: &str) {
    if json {
        eprintln!("{text}");
    } else {
        println!("{text}");
    }
}
