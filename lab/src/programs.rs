//! The programs that write the figures of the docs, one module each.

mod ambient;
mod comb;
pub(crate) mod cost;
mod exposure;
mod hard_cases;
mod points;
mod scene;
mod slowest;
mod surfaces;
mod table1;

use clap::Parser;

use crate::{serial_line, timing};

#[derive(Parser)]
#[command(name = "cargo", bin_name = "cargo")]
enum Program {
    Ambient(ambient::Options),
    Comb(comb::Options),
    Cost(cost::Options),
    Exposure(exposure::Options),
    HardCases(hard_cases::Options),
    Points(points::Options),
    Scene(scene::Options),
    SerialLine(serial_line::Options),
    Slowest(slowest::Options),
    Surfaces(surfaces::Options),
    Table1(table1::Options),
    Timing(timing::Options),
}

/// Runs the program that the command line names.
pub fn main() -> anyhow::Result<()> {
    match &Program::parse() {
        Program::Ambient(options) => ambient::main(options),
        Program::Comb(options) => comb::main(options),
        Program::Cost(options) => cost::main(options),
        Program::Exposure(options) => exposure::main(options),
        Program::HardCases(options) => hard_cases::main(options),
        Program::Points(options) => points::main(options),
        Program::Scene(options) => scene::main(options),
        Program::SerialLine(options) => serial_line::main(options),
        Program::Slowest(options) => slowest::main(options),
        Program::Surfaces(options) => surfaces::main(options),
        Program::Table1(options) => table1::main(options),
        Program::Timing(options) => timing::main(options),
    }
}
