//! Writes the phase tables, and tells the linker about the chip.

use std::fmt::Write as _;
use std::path::PathBuf;

use phase_tables::{Background, COARSE, DEFAULT, Plan, Profile, gaussian, set, slit};

fn main() {
    write_phase_tables();
    link_for_the_chip();
}

/// The tables are designed here in f64 and reach the core as integers; it proves them at compile time.
fn write_phase_tables() {
    let best_for = |noise_ratio| Plan {
        noise_ratio,
        widths: COARSE,
        ..DEFAULT
    };
    let tilted = Plan {
        background: Background::Tilted,
        widths: COARSE,
        ..DEFAULT
    };
    let sets: [(&str, Profile<'_>, Plan); 7] = [
        ("GAUSSIAN", &gaussian, DEFAULT),
        ("READ_NOISE", &gaussian, best_for(f64::INFINITY)),
        ("MOSTLY_SHOT_NOISE", &gaussian, best_for(0.07)),
        ("SHOT_NOISE", &gaussian, best_for(0.02)),
        ("PURE_SHOT_NOISE", &gaussian, best_for(0.006)),
        ("TILTED", &gaussian, tilted),
        ("SLIT", &slit, DEFAULT),
    ];
    let mut source = String::new();
    for (name, profile, plan) in sets {
        let tables = phase_tables::rust_source(&set(profile, plan));
        // Writing to a String cannot fail.
        let _ = writeln!(
            source,
            "pub(super) static {name}: &[Table<'static>] = &{tables};"
        );
    }
    let path =
        PathBuf::from(std::env::var_os("OUT_DIR").expect("cargo sets OUT_DIR")).join("tables.rs");
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
