//! The program links, as the firmware is built and with checks for overflow on; and does not where there is a
//! panic in it.

mod places;

use std::path::PathBuf;
use std::sync::Mutex;

use places::places;
use virtual_board::firmware::{cargo, executable};

/// As the firmware is built.
const RELEASE: &str = "release";

/// The same with a panic wherever the compiler cannot exclude an overflow.
const OVERFLOW_CHECKED: &str = "overflow-checked";

/// What the panic handler calls.
const NOWHERE: &str = "a_panic_is_reachable";

/// Without the checks for overflow the optimiser knows less, so the program for the chip has a check of its
/// own.
#[test]
#[ignore = "`nothing_overflows` excludes panics too, and a second link takes 35 CPU s; .ci/run runs it"]
fn no_panic_is_reachable() {
    check(RELEASE);
}

#[test]
fn nothing_overflows() {
    check(OVERFLOW_CHECKED);
}

fn check(profile: &str) {
    let Err(messages) = link(profile, &[], &[]) else {
        return;
    };
    assert!(messages.contains(NOWHERE), "{messages}");
    let places = places_of(profile, &[]);
    panic!(
        "the core can panic on the chip ({profile}), where it cannot be excluded that this does:\n{places:#?}"
    );
}

/// The check is worth something only if it finds what there is: in each part of the program, behind what the
/// part computed.
#[test]
#[ignore = "links the program four times, 30 s; .ci/run runs it"]
fn a_panic_that_is_put_in_is_found() {
    let feature = ["--features", "put-panics-in"];
    for profile in [RELEASE, OVERFLOW_CHECKED] {
        let messages = link(profile, &feature, &[]).expect_err("it must not link");
        assert!(messages.contains(NOWHERE), "{messages}");
        let places = places_of(profile, &feature);
        let put_in = places
            .iter()
            .filter(|place| place.contains("whole_core.rs"));
        assert_eq!(put_in.count(), 38, "{places:#?}");
    }
}

#[test]
#[ignore = "links the program four times, 30 s; .ci/run runs it"]
fn an_overflow_that_is_put_in_is_found() {
    let feature = ["--features", "put-an-overflow-in"];
    let places = places_of(OVERFLOW_CHECKED, &feature);
    let put_in = places
        .iter()
        .filter(|place| place.contains("whole_core.rs"));
    assert_eq!(put_in.count(), 1, "{places:#?}");
    let places = places_of(RELEASE, &feature);
    assert!(
        !places.iter().any(|place| place.contains("whole_core.rs")),
        "{places:#?}"
    );
}

/// Builds the program, and gives where it is, or what the compiler and the linker said.
fn link(profile: &str, features: &[&str], linker: &[&str]) -> Result<PathBuf, String> {
    let output = cargo()
        .args(["rustc", "--package", "panic-free", "--bin", "panic-free"])
        .args(["--target", "thumbv7em-none-eabihf", "--profile", profile])
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

/// Programs that differ in their features are the same file: one at a time.
static PROGRAM: Mutex<()> = Mutex::new(());

/// Where the program can panic: it is linked all the same, and searched.
fn places_of(profile: &str, features: &[&str]) -> Vec<String> {
    let _turn = PROGRAM.lock();
    let program = link(
        profile,
        features,
        &["-Clink-arg=--unresolved-symbols=ignore-all"],
    )
    .unwrap_or_else(|messages| panic!("{messages}"));
    let bytes = std::fs::read(&program)
        .unwrap_or_else(|error| panic!("cannot read {}: {error}", program.display()));
    places(&bytes)
}
