//! Tests of `selftest`.

use super::common::*;

/// The answer, without the first word of its lines.
fn selftest(board: &mut VirtualBoard) -> Vec<String> {
    let is_last = |line: &str| matches!(line.split(' ').nth(1), Some("pass" | "fail"));
    let lines = ask_until(board, "selftest", is_last);
    println!("{lines:#?}");
    let rest = |line: &String| line.strip_prefix("selftest ").map(str::to_owned);
    let rest = lines.iter().map(rest).collect::<Option<_>>();
    rest.expect("the first word of each line")
}

#[test]
fn a_good_sensor_passes_and_a_bad_one_says_why() {
    let (mut board, _) = boot(paper());
    let lines = selftest(&mut board);
    assert_eq!(lines.len(), 7);
    assert_eq!(lines[6], "pass");
    // Results go on, with whole frames.
    assert!(fresh_results(&mut board, 1)[0].contains(" n 16/16 "));
    board.set_light(spot_at(1800.0, 0.0));
    run_ms(&mut board, 100);
    let lines = selftest(&mut board);
    assert!(lines[4].starts_with("light fail f no spot"));
    assert_eq!(lines[6], "fail 1");
    set(&mut board, "stream off");
    board.open_line(Some(OpenLine::Ones));
    run_ms(&mut board, 300);
    let lines = selftest(&mut board);
    assert!(lines[1].starts_with("rows fail "));
    assert_eq!(lines.last().expect("a line"), "fail 1");
}
