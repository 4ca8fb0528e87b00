//! The command `calibrate fit`, as a user runs it.

use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output};

use calibration::points::Point;
use slitrange::base::units::Pixels;
use slitrange::centre::Estimator;
use slitrange::distance::Calibration;
use slitrange_tool::record_file;

use super::truth::{Truth, seeded, throw_off};

fn slitrange(directory: &Path, options: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_slitrange"))
        .current_dir(directory)
        .args(["calibrate", "fit"])
        .args(options)
        .output()
        .expect("it runs")
}

fn printed(output: &Output) -> String {
    let text = match output.status.success() {
        true => &output.stdout,
        false => &output.stderr,
    };
    String::from_utf8_lossy(text).into_owned()
}

fn file(path: &Path, points: &[Point]) {
    let mut text =
        String::from("# serial 42\n# estimator adaptive\n# black frame\nx_px,d_mm,sigma_px\n");
    for point in points {
        let _ = writeln!(text, "{:.5},{:.4},0.002", point.x_px, point.d_mm);
    }
    std::fs::write(path, text).expect("written");
}

/// Points of a distorted row with three outliers: the report, the record and the figure.
#[test]
fn points_become_a_record_a_report_and_a_figure() {
    let directory = tempfile::tempdir().expect("a directory");
    let truth = Truth::distorted(0.03);
    let mut points = truth.points(60, 0.002, &mut seeded(1));
    throw_off(&mut points, 3, 2.0, false, &mut seeded(2));
    file(&directory.path().join("points.csv"), &points);
    let output = slitrange(
        directory.path(),
        &["points.csv", "--date", "2026-01-31", "--figure", "fit.svg"],
    );
    insta::assert_snapshot!(printed(&output));

    let record = record_file::read(&directory.path().join("points.record")).expect("a record");
    let record = record.record();
    assert_eq!(
        (record.serial_number, record.estimator),
        (42, Estimator::Adaptive)
    );
    assert!(matches!(record.calibration, Calibration::Corrected(_)));
    let valid = record.calibration.valid();
    let inside = |x: f64| (valid.0.to_f64()..=valid.1.to_f64()).contains(&x);
    let (rms, largest) = truth.error_where(inside, |x| {
        let at = Pixels::from_bits((x * 65536.0).round() as i32);
        let (distance, _) = record.calibration.distance_at(at).expect("in range");
        1e-6 * distance.to_f64()
    });
    println!("the sensor's distances: RMS {rms:.3} um, largest {largest:.3} um");
    assert!(rms < 0.6 && largest < 4.0);

    let svg = std::fs::read_to_string(directory.path().join("fit.svg")).expect("a figure");
    assert_eq!(svg.matches("<circle").count(), 3 * 57);
    for words in [
        "60 points and their fit (3 rejected, red)",
        "what is left",
        "D = ",
        "K = ",
        "xp = ",
    ] {
        assert!(svg.contains(words), "{words}");
    }
}

#[test]
fn options_override_the_points_and_json_prints_the_report() {
    let directory = tempfile::tempdir().expect("a directory");
    let points = Truth::nominal().points(20, 0.002, &mut seeded(3));
    file(&directory.path().join("points.csv"), &points);
    let output = slitrange(
        directory.path(),
        &[
            "points.csv",
            "--json",
            "--serial",
            "7",
            "--estimator",
            "adaptive",
            "--black",
            "fixed 120",
            "-o",
            "other",
            "--date",
            "2026-02-28",
            "--form",
            "table",
            "--position-uncertainty",
            "0.001",
        ],
    );
    assert!(output.status.success(), "{}", printed(&output));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let parameters = Truth::nominal().parameters();
    let d = report["eq1"]["d_mm"]["value"].as_f64().expect("D");
    let uncertainty = report["eq1"]["d_mm"]["uncertainty"]
        .as_f64()
        .expect("its uncertainty");
    assert!(
        (d - 1e3 * parameters[0]).abs() < 4.0 * uncertainty,
        "{d} +- {uncertainty}"
    );
    assert_eq!(report["form"], "table");
    assert_eq!(report["record"]["serial"], 7);
    assert_eq!(report["record"]["black"], "fixed 120");
    assert_eq!(report["record"]["date"], "2026-02-28");
    let record = record_file::read(&directory.path().join("other")).expect("a record");
    let record = record.record();
    assert!(matches!(record.calibration, Calibration::Table(_)));
    assert_eq!(record.estimator, Estimator::Adaptive);
    let keys: Vec<&String> = report.as_object().expect("an object").keys().collect();
    insta::assert_debug_snapshot!(keys);
}

#[test]
fn another_record_is_not_replaced_unless_forced() {
    let directory = tempfile::tempdir().expect("a directory");
    let points = Truth::nominal().points(20, 0.002, &mut seeded(3));
    file(&directory.path().join("points.csv"), &points);
    let record = directory.path().join("sensor.record");
    let fit = |options: &[&str]| {
        let output = [&["points.csv", "-o", "sensor.record"], options].concat();
        let output = slitrange(directory.path(), &output);
        (output.status.code(), printed(&output))
    };
    assert_eq!(fit(&["--date", "2026-01-31"]).0, Some(0));
    let first = std::fs::read(&record).expect("a record");
    // The same again replaces nothing.
    assert_eq!(fit(&["--date", "2026-01-31"]).0, Some(0));
    let (code, said) = fit(&["--date", "2026-02-01"]);
    assert_eq!(code, Some(2));
    assert_eq!(
        said,
        "slitrange: sensor.record stays as it is, it holds something else than this record: name another \
         file with --output, or replace it with --force\n"
    );
    assert_eq!(std::fs::read(&record).expect("a record"), first);
    assert_eq!(fit(&["--date", "2026-02-01", "--force"]).0, Some(0));
    assert_ne!(std::fs::read(&record).expect("a record"), first);
}

/// The first line says how good the calibration is, with the curve's largest uncertainty over its range.
#[test]
fn the_first_line_is_a_verdict() {
    let directory = tempfile::tempdir().expect("a directory");
    let verdict = |points: &[Point], options: &[&str]| {
        file(&directory.path().join("points.csv"), points);
        let output = slitrange(
            directory.path(),
            &[&["points.csv", "--force"], options].concat(),
        );
        assert!(output.status.success(), "{}", printed(&output));
        let line = printed(&output).lines().next().expect("a line").to_owned();
        println!("{line}");
        line
    };
    let points = |count| Truth::nominal().points(count, 0.002, &mut seeded(4));
    let good = verdict(&points(20), &[]);
    assert!(
        good.starts_with("Calibration good: the curve is uncertain by "),
        "{good}"
    );
    let few = verdict(&points(9), &[]);
    assert!(few.starts_with("Calibration usable: "), "{few}");
    assert!(
        few.ends_with("; with fewer than 10 points, none could be rejected"),
        "{few}"
    );
    // Three of twenty distances are off by 2 mm.
    let mut bad = points(20);
    throw_off(&mut bad, 3, 2.0, false, &mut seeded(2));
    let bad = verdict(&bad, &[]);
    assert!(
        bad.starts_with("Calibration usable: ") && bad.contains("; 3 of 20 points are rejected"),
        "{bad}"
    );
    // Distances known to 10 mm: a hundredth of the range is 4.2 mm.
    let coarse = verdict(&points(4), &["--position-uncertainty", "10"]);
    assert!(coarse.starts_with("Calibration not usable: "), "{coarse}");
    assert!(
        coarse.contains("; that is more than 1 % of the range: "),
        "{coarse}"
    );
}

/// Other programs take `-` for standard output. This one would make a file with that name.
#[test]
fn a_file_named_by_a_dash_is_refused() {
    let directory = tempfile::tempdir().expect("a directory");
    let points = Truth::nominal().points(20, 0.002, &mut seeded(3));
    file(&directory.path().join("points.csv"), &points);
    for option in ["-o", "--figure"] {
        let output = slitrange(directory.path(), &["points.csv", option, "-"]);
        assert_eq!(output.status.code(), Some(2), "{option}");
        let said = printed(&output);
        assert!(
            said.contains("name a file: this command does not write to"),
            "{said}"
        );
        assert!(!directory.path().join("-").exists());
    }
}

/// A refused file of points makes no record, and leaves an older record unchanged.
#[test]
fn refusals_leave_existing_files_unchanged() {
    let directory = tempfile::tempdir().expect("a directory");
    let points = Truth::nominal().points(20, 0.002, &mut seeded(3));
    file(&directory.path().join("good.csv"), &points);
    file(&directory.path().join("two.csv"), &points[..2]);
    std::fs::write(directory.path().join("two.record"), "older").expect("written");
    let mut said = String::new();
    for options in [
        &["two.csv"][..],
        &["none.csv"],
        &["good.csv", "-o", "good.csv"],
    ] {
        let output = slitrange(directory.path(), options);
        assert_eq!(output.status.code(), Some(2), "{options:?}");
        said += &format!("{}\n  {}", options.join(" "), printed(&output));
    }
    insta::assert_snapshot!(said);
    let older = std::fs::read_to_string(directory.path().join("two.record")).expect("it is there");
    assert_eq!(older, "older");
    assert!(!directory.path().join("good.record").exists());
}
