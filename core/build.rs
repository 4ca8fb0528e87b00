//! Designs the phase tables in f64 and writes them as integers. The core proves at compile time that they
//! cannot overflow.

use std::fmt::Write as _;
use std::path::PathBuf;

use phase_tables::{
    Background, COARSE, DEFAULT, FRAUNHOFER, LOPSIDED, Plan, Profile, gaussian, set, slit,
};

fn main() {
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
    let sets: [(&str, Profile<'_>, Plan); 8] = [
        ("GAUSSIAN", &gaussian, DEFAULT),
        ("READ_NOISE", &gaussian, best_for(f64::INFINITY)),
        ("MOSTLY_SHOT_NOISE", &gaussian, best_for(0.07)),
        ("SHOT_NOISE", &gaussian, best_for(0.02)),
        ("PURE_SHOT_NOISE", &gaussian, best_for(0.006)),
        ("TILTED", &gaussian, tilted),
        ("LOPSIDED", &gaussian, LOPSIDED),
        ("SLIT", &slit, FRAUNHOFER),
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
