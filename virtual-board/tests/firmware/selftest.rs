//! Tests of `selftest`.

use std::time::Duration;

use virtual_board::{OpenLine, VirtualBoard};

use super::common::{PATIENCE, boot, fresh_results, is_result, paper, set, spot_at};

/// The answer, without the first word of its lines.
fn selftest(board: &mut VirtualBoard) -> Vec<String> {
    board.send("selftest\r\n");
    let mut lines = vec![];
    loop {
        let line = board.run_until_line(|line| !is_result(line), PATIENCE);
        let line = line.expect("a line").text;
        let line = line.strip_prefix("selftest ").expect("its first word");
        lines.push(line.to_owned());
        if line.starts_with("pass") || line.starts_with("fail") {
            println!("{lines:#?}");
            return lines;
        }
    }
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
    board.run_for(Duration::from_millis(100)).expect("a run");
    let lines = selftest(&mut board);
    assert!(lines[4].starts_with("light fail f no spot"));
    assert_eq!(lines[6], "fail 1");
    set(&mut board, "stream off");
    board.open_line(Some(OpenLine::Ones));
    board.run_for(Duration::from_millis(300)).expect("a run");
    let lines = selftest(&mut board);
    assert!(lines[1].starts_with("rows fail "));
    assert_eq!(lines.last().expect("a line"), "fail 1");
    board.finish().expect("a clean run");
}
