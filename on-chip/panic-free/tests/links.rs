//! The program links, as the firmware is built and with checks for overflow on; and does not where there is a
//! panic in it.

mod places;

use std::path::PathBuf;
use std::sync::Mutex;

use places::places;
use virtual_board::firmware::{cargo, executable};

/// How the program is built: cargo's options beside `--release`.
type Build = &'static [&'static str];

/// As the firmware is built.
const RELEASE: Build = &[];

/// The same with checks for overflow: a panic for each operation that may overflow for all that the compiler
/// can prove. If the program links, no checked operation overflows (docs/proofs.md). Three crates are
/// compiled as published. These three, and the crates that run on the PC, are those of the firmware's build.
const OVERFLOW_CHECKED: Build = &[
    "--config=profile.release.overflow-checks=true",
    "--config=profile.release.build-override.overflow-checks=false",
    "--config=profile.release.package.heapless.overflow-checks=false",
    "--config=profile.release.package.libm.overflow-checks=false",
    "--config=profile.release.package.postcard.overflow-checks=false",
    // For size, the optimiser finds fewer ranges. What cannot overflow does so at no level.
    "--config=profile.release.package.slitrange-device.opt-level=3",
];

/// All these programs are the same file: one at a time.
static PROGRAM: Mutex<()> = Mutex::new(());

/// What the panic handler calls.
const NOWHERE: &str = "a_panic_is_reachable";

/// Without the checks for overflow the optimiser knows less, so the program for the chip has a check of its
/// own.
#[test]
#[ignore = "links the whole core for the chip, 40 CPU s; .ci/run runs it"]
fn no_panic_is_reachable() {
    check(RELEASE);
}

#[test]
#[ignore = "links the whole core for the chip, 40 CPU s; .ci/run runs it"]
fn nothing_overflows() {
    check(OVERFLOW_CHECKED);
}

fn check(build: Build) {
    let _turn = PROGRAM.lock();
    let Err(messages) = link(build, &[], &[]) else {
        return;
    };
    assert!(messages.contains(NOWHERE), "{messages}");
    let places = places_of(build, &[]);
    panic!(
        "the core can panic on the chip ({build:?}), where it cannot be excluded that this does:\n{places:#?}"
    );
}

/// The check is worth something only if it finds what there is: in each part of the program, behind what the
/// part computed.
#[test]
#[ignore = "links the program four times, 30 s; .ci/run runs it"]
fn a_panic_that_is_put_in_is_found() {
    let _turn = PROGRAM.lock();
    let feature = ["--features", "put-panics-in"];
    for build in [RELEASE, OVERFLOW_CHECKED] {
        let messages = link(build, &feature, &[]).expect_err("it must not link");
        assert!(messages.contains(NOWHERE), "{messages}");
        expect_put_in(38, &places_of(build, &feature));
    }
}

#[test]
#[ignore = "links the program four times, 30 s; .ci/run runs it"]
fn an_overflow_that_is_put_in_is_found() {
    let _turn = PROGRAM.lock();
    let feature = ["--features", "put-an-overflow-in"];
    expect_put_in(1, &places_of(OVERFLOW_CHECKED, &feature));
    expect_put_in(0, &places_of(RELEASE, &feature));
}

fn expect_put_in(count: usize, places: &[String]) {
    let put_in = (places.iter()).filter(|place| place.contains("whole_core.rs"));
    assert_eq!(put_in.count(), count, "{places:#?}");
}

/// Builds the program, and gives where it is, or what the compiler and the linker said.
fn link(build: Build, features: &[&str], linker: &[&str]) -> Result<PathBuf, String> {
    let output = cargo()
        .args(["rustc", "--package", "panic-free", "--bin", "panic-free"])
        .args(["--target", "thumbv7em-none-eabihf", "--release"])
        .args(build)
        .args(features)
        .arg("--message-format=json-render-diagnostics")
        .arg("--")
        .args(linker)
        .output()
        .expect("cargo starts");
    if output.status.success() {
        Ok(executable(&output.stdout).expect("cargo names the program"))
    } else {
        Err(String::from_utf8_lossy(&output.stderr).into_owned())
    }
}

/// Where the program can panic: it is linked all the same, and searched.
fn places_of(build: Build, features: &[&str]) -> Vec<String> {
    let linker = ["-Clink-arg=--unresolved-symbols=ignore-all"];
    let program = link(build, features, &linker).unwrap_or_else(|messages| panic!("{messages}"));
    places(&std::fs::read(program).expect("the program that was linked"))
}
