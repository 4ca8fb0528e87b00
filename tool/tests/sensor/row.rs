//! `slitrange row` shows a row as the sensor sees it.

use slitrange_device::protocol::row_lines::{ROW_END, RowPart};
use slitrange_tool::sensor::line::TRIES;
use slitrange_tool::sensor::row::RowAnswer;

use super::stand_in::{StandIn, Trouble};
use crate::command::*;

#[test]
fn a_row_is_summarised_tabulated_and_drawn() {
    let sensor = StandIn::new(1);
    let output = sensor.done("row --port PORT --csv @row.csv --figure @row.svg");
    let parts = [
        "sensor TCD1304DG at ",
        "centre 1800.2",
        "exposure 5600 us, black level 300.00 counts",
        "pixels 0 to 3647 of 3648: median 300 counts",
    ];
    says(&output, parts);
    let table = sensor.text("row.csv");
    let mut lines = table.lines();
    assert_eq!(lines.next(), Some("pixel,counts,fit_counts"));
    let (mut worst, mut count) = (0.0f64, 0);
    for (place, line) in lines.enumerate() {
        let fields = line.split(',').map(|it| it.parse().expect("a number"));
        let fields: Vec<f64> = fields.collect();
        assert_eq!(fields[0], place as f64);
        worst = worst.max((fields[1] - fields[2]).abs());
        count += 1;
    }
    // Pixels are off by 3 counts, and rounded. The width's 0.01 px are 2 counts on the flank.
    println!("the fit leaves at most {worst:.1} counts");
    assert_eq!(count, 3648);
    assert!(worst < 8.0);
    let titles = [
        "the row: centre 1800.2",
        "pixels (blue) and fit (red)",
        "what the fit leaves",
        "saturated",
        "level beside the spot",
        "black level",
    ];
    says(&sensor.text("row.svg"), titles);
    assert!(sensor.state().settings().stream, "the stream is put back");
}

#[test]
fn a_range_comes_whole_with_a_dark_row_and_with_a_fault() {
    let sensor = StandIn::new(4);
    let range = "row --port PORT --pixels 1700 1839 --figure @row.svg";
    let median = "pixels 1700 to 1839 of 3648: median 300 counts";
    says(&sensor.done(range), ["centre 1800.2", median]);
    sensor.state().type_line("laser off");
    let dark = "laser off, black level 300.00 counts";
    let output = sensor.done(range);
    says(&output, ["no centre: laser off\n", dark, median]);
    sensor.state().type_lines("laser on; exposure 187");
    sensor.state().spot_height = 9000.0;
    let parts = [
        "no centre: saturated",
        "exposure 187 us",
        "pixels 1700 to 1839 of 3648",
        " pixels are saturated, with 4095 counts or more",
    ];
    says(&sensor.done(range), parts);
}

#[test]
fn a_part_of_the_row_comes_and_a_reversed_range_is_refused() {
    let sensor = StandIn::new(5);
    for (part, pixels) in [
        ("--window", "pixels 1752 to 1848 of 3648"),
        // The spot's flank, without the centre.
        (
            "--pixels 1804 1860",
            "pixels 1804 to 1860 of 3648: median 300 counts",
        ),
        ("--pixels 1804 1860 --figure @row.svg", "drawn: "),
        // Cut off at the row's end.
        ("--pixels 3600 9999", "pixels 3600 to 3647 of 3648"),
    ] {
        says(&sensor.done(&format!("row --port PORT {part}")), [pixels]);
    }
    let error = sensor.refused("row --port PORT --pixels 1839 1700");
    says(&error, ["the first pixel lies beyond the last one"]);
    let error = sensor.refused("row --port PORT --pixels 3648 9999");
    says(
        &error,
        ["--pixels 3648 9999 is beyond the row, which has the pixels 0 to 3647"],
    );
}

/// What the tool's reader first makes of lines that arrive in turn. `None` if it waits for more.
fn read(bytes: &[u8]) -> Option<Option<RowAnswer>> {
    // As the line does: CR or LF ends a line, and empty lines do not count.
    let lines = bytes.split(|byte| b"\r\n".contains(byte));
    let lines = lines.filter(|line| !line.is_empty());
    let lines = lines.map(|line| String::from_utf8_lossy(line).into_owned());
    let lines: Vec<String> = lines.collect();
    (1..=lines.len()).find_map(|count| RowAnswer::read(&lines[..count]))
}

/// Whatever character changes or is lost, the same values are read (a line end or the last line), or none.
#[test]
fn any_changed_character_of_an_answer_is_noticed() {
    let sensor = StandIn::new(6);
    let range = |first, last| RowPart::Range { first, last };
    for (settings, part) in [
        ("exposure 187", range(1780, 1829)),
        ("slits comb", range(1780, 1829)),
        ("slits one; laser off", range(1780, 1829)),
        ("laser off", RowPart::Window),
        ("laser on", range(4000, 4000)),
    ] {
        sensor.state().type_lines(settings);
        let answer = sensor.state().row(part).into_bytes();
        println!("{}", String::from_utf8_lossy(&answer));
        let whole = read(&answer).expect("an answer").expect("whole");
        let last_line = answer.len() - ROW_END.len() - 2;
        let mut same = 0;
        for place in 0..answer.len() {
            let was = answer[place];
            let flipped = (0..8).map(|bit| was ^ (1 << bit));
            let others = flipped.chain(*b"\r\n\t 0179afExz-.()");
            let others = others.filter(|&byte| byte != was).map(|byte| vec![byte]);
            for other in others.chain([vec![]]) {
                let changed = [&answer[..place], &other, &answer[place + 1..]].concat();
                let Some(Some(found)) = read(&changed) else {
                    continue;
                };
                let text = String::from_utf8_lossy(&changed);
                assert!(place >= last_line || b"\r\n".contains(&was), "{text}");
                assert_eq!(found, whole, "{text}");
                same += 1;
            }
        }
        println!("{same} changes left the values as they were");
        // A lost or spoilt last line costs nothing.
        assert_eq!(read(&answer[..last_line]), Some(Some(whole)));
    }
}

/// No wrong pixel is shown. If a line is missing in all [`TRIES`] answers, the tool says so.
#[test]
fn spoilt_lines_are_never_shown() {
    let mut shown = 0;
    for seed in 0..20 {
        let sensor = StandIn::new(seed);
        sensor.state().trouble = Trouble::of_line(0.01, 0.01);
        let (result, _) = sensor.run("row --port PORT --window --csv @row.csv");
        if result.is_ok() {
            let table = sensor.text("row.csv");
            let counts = table.lines().filter_map(|line| line.split(',').nth(1));
            let highest = counts.filter_map(|count| count.parse::<u16>().ok()).max();
            assert!(highest.is_some_and(|highest| (2290..=2303).contains(&highest)));
            shown += 1;
        }
    }
    println!("{shown} of 20 windows arrived");
    assert!(shown >= 18);
    // All of the 114 lines seldom arrive.
    let lossy = StandIn::new(3);
    lossy.state().trouble.lost = 0.2;
    let error = lossy.refused("row --port PORT");
    assert!(error.contains(&format!("{TRIES} tries")) || error.contains("no answer"));
}
