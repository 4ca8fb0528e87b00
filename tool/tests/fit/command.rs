//! The command `calibrate fit`, as a user runs it.

use std::fmt::Write as _;
use std::process::Command;

use super::truth::{Truth, seeded, throw_off};
use crate::command::*;

struct Folder(tempfile::TempDir);

impl Folder {
    fn with(points: &[Point]) -> Self {
        let folder = Self(tempfile::tempdir().expect("a directory"));
        folder.write("points.csv", points);
        folder
    }

    fn nominal() -> Self {
        Self::with(&Truth::nominal().points(20, 0.002, &mut seeded(3)))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, points: &[Point]) {
        let mut text =
            String::from("# serial 42\n# estimator adaptive\n# black frame\nx_px,d_mm,sigma_px\n");
        for point in points {
            let _ = writeln!(text, "{:.5},{:.4},0.002", point.x_px, point.d_mm);
        }
        std::fs::write(self.path(name), text).expect("written");
    }

    /// `slitrange calibrate fit` with options, + for a blank: the exit code, and what is said.
    fn fit(&self, options: &str) -> (Option<i32>, String) {
        let output = Command::new(env!("CARGO_BIN_EXE_slitrange"))
            .current_dir(self.0.path())
            .args(["calibrate", "fit"])
            .args(options.split(' ').map(|word| word.replace('+', " ")))
            .output()
            .expect("it runs");
        let said = match output.status.success() {
            true => output.stdout,
            false => output.stderr,
        };
        (output.status.code(), String::from_utf8(said).expect("text"))
    }

    /// What is said if it succeeds.
    fn fits(&self, options: &str) -> String {
        let (code, said) = self.fit(options);
        assert_eq!(code, Some(0), "{said}");
        said
    }

    fn record(&self, name: &str) -> Record {
        let record = record_file::read(&self.path(name)).expect("a record");
        record.record().clone()
    }
}

/// Points of a distorted row with three outliers: the report, the record and the figure.
#[test]
fn points_become_a_record_a_report_and_a_figure() {
    let truth = Truth::distorted(0.03);
    let mut points = truth.points(60, 0.002, &mut seeded(1));
    throw_off(&mut points, 3, 2.0, false, &mut seeded(2));
    let folder = Folder::with(&points);
    insta::assert_snapshot!(folder.fits("points.csv --date 2026-01-31 --figure fit.svg"));
    let record = folder.record("points.record");
    assert_eq!(record.serial_number, 42);
    assert_eq!(record.estimator, Estimator::Adaptive);
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
    let svg = std::fs::read_to_string(folder.path("fit.svg")).expect("a figure");
    assert_eq!(svg.matches("<circle").count(), 3 * 57);
    let rejected = "60 points and their fit (3 rejected, red)";
    says(&svg, [rejected, "what is left", "D = ", "K = ", "xp = "]);
}

#[test]
fn options_override_the_points_and_json_prints_the_report() {
    let folder = Folder::nominal();
    let said = folder.fits(
        "points.csv --json --serial 7 --estimator adaptive --black fixed+120 -o other --date 2026-02-28 \
         --form table --position-uncertainty 0.001",
    );
    let report: serde_json::Value = serde_json::from_str(&said).expect("JSON");
    let parameters = Truth::nominal().parameters();
    let d = &report["eq1"]["d_mm"];
    let number = |name| d[name].as_f64().expect("a number");
    let off = (number("value") - 1e3 * parameters[0]).abs();
    assert!(off < 4.0 * number("uncertainty"), "{d}");
    assert_eq!(report["form"], "table");
    assert_eq!(report["record"]["serial"], 7);
    assert_eq!(report["record"]["black"], "fixed 120");
    assert_eq!(report["record"]["date"], "2026-02-28");
    let record = folder.record("other");
    assert!(matches!(record.calibration, Calibration::Table(_)));
    assert_eq!(record.estimator, Estimator::Adaptive);
    let keys: Vec<&String> = report.as_object().expect("an object").keys().collect();
    insta::assert_debug_snapshot!(keys);
}

#[test]
fn another_record_is_not_replaced_unless_forced() {
    let folder = Folder::nominal();
    let fit = |more: &str| folder.fit(&format!("points.csv -o sensor.record {more}"));
    let record = || std::fs::read(folder.path("sensor.record")).expect("a record");
    assert_eq!(fit("--date 2026-01-31").0, Some(0));
    let first = record();
    // The same again replaces nothing.
    assert_eq!(fit("--date 2026-01-31").0, Some(0));
    let (code, said) = fit("--date 2026-02-01");
    assert_eq!(code, Some(2));
    assert_eq!(
        said,
        "slitrange: sensor.record stays as it is, it holds something else than this record: name another \
         file with --output, or replace it with --force\n"
    );
    assert_eq!(record(), first);
    assert_eq!(fit("--date 2026-02-01 --force").0, Some(0));
    assert_ne!(record(), first);
}

/// The first line says how good the calibration is, with the curve's largest uncertainty over its range.
#[test]
fn the_first_line_is_a_verdict() {
    let verdict = |points: &[Point], options: &str| {
        let said = Folder::with(points).fits(&format!("points.csv --force{options}"));
        let line = said.lines().next().expect("a line").to_owned();
        println!("{line}");
        line
    };
    let points = |count| Truth::nominal().points(count, 0.002, &mut seeded(4));
    let good = verdict(&points(20), "");
    begins(&good, "Calibration good: the curve is uncertain by ");
    let few = verdict(&points(9), "");
    begins(&few, "Calibration usable: ");
    ends(&few, "; with fewer than 10 points, none could be rejected");
    // Three of twenty distances are off by 2 mm.
    let mut bad = points(20);
    throw_off(&mut bad, 3, 2.0, false, &mut seeded(2));
    let bad = verdict(&bad, "");
    begins(&bad, "Calibration usable: ");
    says(&bad, ["; 3 of 20 points are rejected"]);
    // Distances known to 10 mm: a hundredth of the range is 4.2 mm.
    let coarse = verdict(&points(4), " --position-uncertainty 10");
    begins(&coarse, "Calibration not usable: ");
    says(&coarse, ["; that is more than 1 % of the range: "]);
}

/// The nominal head in wrong units and columns, and three points, which name no estimator.
#[test]
fn slips_of_units_and_columns_are_not_usable() {
    let folder = Folder::nominal();
    let points = |count| Truth::nominal().points(count, 0.002, &mut seeded(4));
    for (count, unit, columns, cause) in [
        (20, 10.0, "x_px,d_mm", "d_mm seems to be in centimetres"),
        (20, 25.4, "x_px,d_mm", "d_mm seems to be in inches"),
        (
            20,
            1.0,
            "d_mm,x_px",
            "the columns x_px and d_mm seem to be exchanged",
        ),
        (
            3,
            1.0,
            "x_px,d_mm",
            "nothing tells how uncertain the curve is",
        ),
    ] {
        let mut text = format!("{columns}\n");
        for point in points(count) {
            let _ = writeln!(text, "{:.5},{:.5}", point.x_px, point.d_mm / unit);
        }
        std::fs::write(folder.path("slip.csv"), text).expect("written");
        let said = folder.fits("slip.csv --force");
        begins(&said, "Calibration not usable: ");
        says(
            &said,
            [
                cause,
                "the points name no estimator, and the record takes adaptive",
            ],
        );
        let record = folder.record("slip.record");
        assert_eq!(record.estimator, Estimator::Adaptive);
        // `calibrate write` says the same, and a sensor never takes an unknown uncertainty for none.
        let against = calibration::record::verdict::against(&record);
        says(&against.expect("not usable"), [cause]);
        assert_ne!(record.errors, CalibrationErrors::Unknown);
    }
}

/// Other programs take `-` for standard output. This one would make a file with that name.
#[test]
fn a_file_named_by_a_dash_is_refused() {
    let folder = Folder::nominal();
    for option in ["-o", "--figure"] {
        let (code, said) = folder.fit(&format!("points.csv {option} -"));
        assert_eq!(code, Some(2), "{option}");
        says(&said, ["name a file: this command does not write to"]);
        assert!(!folder.path("-").exists());
    }
}

#[test]
fn refusals_leave_existing_files_unchanged() {
    let points = Truth::nominal().points(20, 0.002, &mut seeded(3));
    let folder = Folder::with(&[]);
    folder.write("good.csv", &points);
    folder.write("two.csv", &points[..2]);
    std::fs::write(folder.path("two.record"), "older").expect("written");
    let mut all = String::new();
    for options in ["two.csv", "none.csv", "good.csv -o good.csv"] {
        let (code, said) = folder.fit(options);
        assert_eq!(code, Some(2), "{options}");
        all += &format!("{options}\n  {said}");
    }
    insta::assert_snapshot!(all);
    let older = std::fs::read_to_string(folder.path("two.record"));
    assert_eq!(older.expect("it is there"), "older");
    assert!(!folder.path("good.record").exists());
}
