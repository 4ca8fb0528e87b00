//! Writes the phase tables of the gaussian, and tells the linker about the chip.

use std::path::PathBuf;

fn main() {
    write_phase_tables();
    link_for_the_chip();
}

/// The tables are designed here in f64 and reach the core as integers; it proves them at compile time.
fn write_phase_tables() {
    let tables = phase_tables::set(&phase_tables::gaussian, phase_tables::DEFAULT_NOISE_RATIO);
    let path =
        PathBuf::from(std::env::var_os("OUT_DIR").expect("cargo sets OUT_DIR")).join("gaussian.rs");
    let source = format!("static TABLES: {};\n", phase_tables::rust_source(&tables));
    std::fs::write(&path, source)
        .unwrap_or_else(|error| panic!("cannot write {}: {error}", path.display()));
    println!("cargo::rerun-if-changed=build.rs");
}

/// Gives the linker the chip's memory and the sections of cortex-m-rt and defmt; on a PC it needs none of them.
fn link_for_the_chip() {
    println!("cargo::rerun-if-changed=memory.x");
    if std::env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let here = std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    println!("cargo::rustc-link-search={here}");
    // --nmagic: no padding to 64 KB pages, so that the ELF file's sections can be flashed as they are.
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo::rustc-link-arg-bins={argument}");
    }
}
