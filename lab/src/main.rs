//! Runs one of the programs that write the figures of slitrange's docs. `.cargo/config.toml` gives each of
//! them an alias: `cargo cost`, `cargo scene` and so on.
#![forbid(unsafe_code)]

use clap::Parser;
use lab::programs::{
    ambient, comb, cost, exposure, hard_cases, points, scene, serial_line, slowest, surfaces,
    table1, timing,
};

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

fn main() -> anyhow::Result<()> {
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
