//! `slitrange row` shows a row as the sensor sees it.

use std::fs;

use slitrange_tool::sensor::line::TRIES;

use crate::stand_in::{StandIn, Trouble};

/// Runs `slitrange row` with further options.
fn row(sensor: &StandIn, options: &[&str]) -> (Result<(), String>, String) {
    let port = sensor.port();
    let arguments: Vec<&str> = ["--port", &port].iter().chain(options).copied().collect();
    let (result, output) = sensor.command("row", &arguments, "");
    (result.map(|_| ()), output)
}

#[test]
fn a_row_is_summarised_tabulated_and_drawn() {
    let sensor = StandIn::new(1, Trouble::default());
    let (csv, figure) = (sensor.path("row.csv"), sensor.path("row.svg"));
    let path = |path: &std::path::Path| path.to_str().expect("text").to_owned();
    let (csv_path, figure_path) = (path(&csv), path(&figure));
    let (result, output) = row(&sensor, &["--csv", &csv_path, "--figure", &figure_path]);
    result.expect("a row");
    println!("{output}");
    for part in [
        "sensor TCD1304DG at ",
        "centre 1800.2",
        "pixels 0 to 3647 of 3648: median 300 counts",
    ] {
        assert!(output.contains(part), "{part}");
    }
    let table = fs::read_to_string(csv).expect("a table");
    let mut lines = table.lines();
    assert_eq!(lines.next(), Some("pixel,counts,fit_counts"));
    let mut worst = 0.0f64;
    let mut count = 0;
    for (place, line) in lines.enumerate() {
        let fields: Vec<f64> = line
            .split(',')
            .map(|it| it.parse().expect("a number"))
            .collect();
        assert_eq!(fields[0], place as f64);
        worst = worst.max((fields[1] - fields[2]).abs());
        count += 1;
    }
    // The stand-in's pixels are off by 3 counts, and rounded. The sensor knows the width to 0.01 px, that is
    // 2 counts on the flank.
    println!("the fit leaves at most {worst:.1} counts");
    assert_eq!(count, 3648);
    assert!(worst < 8.0);
    let drawn = fs::read_to_string(figure).expect("a figure");
    for title in [
        "the row: centre 1800.2",
        "pixels (blue) and fit (red)",
        "what the fit leaves",
    ] {
        assert!(drawn.contains(title), "{title}");
    }
    assert!(sensor.state().settings().stream, "the stream is put back");
}

#[test]
fn a_window_is_a_hundred_pixels() {
    let sensor = StandIn::new(2, Trouble::default());
    let (result, output) = row(&sensor, &["--window"]);
    result.expect("a row");
    assert!(output.contains("pixels 1752 to 1848 of 3648"), "{output}");
}

/// Each line of pixels has a checksum, so the tool shows no wrong pixel. If a line is missing in all
/// [`TRIES`] answers, the tool says so.
#[test]
fn spoilt_lines_are_never_shown() {
    let trouble = Trouble {
        lost: 0.01,
        garbled: 0.01,
        ..Trouble::default()
    };
    let mut shown = 0;
    for seed in 0..20 {
        let sensor = StandIn::new(seed, trouble);
        let csv = sensor.path("row.csv");
        let (result, _) = row(&sensor, &["--window", "--csv", csv.to_str().expect("text")]);
        if result.is_ok() {
            let table = fs::read_to_string(csv).expect("a table");
            let highest = table
                .lines()
                .skip(1)
                .filter_map(|line| line.split(',').nth(1));
            let highest = highest.filter_map(|count| count.parse::<u16>().ok()).max();
            assert!(highest.is_some_and(|highest| (2290..=2303).contains(&highest)));
            shown += 1;
        }
    }
    println!("{shown} of 20 windows arrived");
    assert!(shown >= 18);
    // All of the 114 lines seldom arrive.
    let lossy = Trouble {
        lost: 0.2,
        ..Trouble::default()
    };
    let error = row(&StandIn::new(3, lossy), &[]).0.expect_err("no row");
    println!("{error}");
    assert!(error.contains(&format!("{TRIES} tries")) || error.contains("no answer"));
}
