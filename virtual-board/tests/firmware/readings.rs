//! Tests of the settings that act between a frame's reading and its line.

use super::common::*;

/// The next line that begins as asked.
fn line(board: &mut VirtualBoard, start: &str) -> String {
    await_line(board, |line| line.starts_with(start)).text
}

/// Each setting once, on the firmware.
#[test]
fn each_setting_of_the_lines_acts() {
    let mut board = measuring(4);
    fresh_results(&mut board, 1);

    // A frame of four rows ends every 22.8 ms. The firmware notes the time when it has computed the last row.
    tell(&mut board, "output counter time distance");
    let lines = [(); 4].map(|()| line(&mut board, "# "));
    println!("{lines:#?}");
    let numbers = lines.each_ref().map(|line| number(line, "# ", " @ "));
    let times = lines.each_ref().map(|line| number(line, " @ ", " d "));
    for (pair, times) in numbers.windows(2).zip(times.windows(2)) {
        assert_eq!(pair[1] - pair[0], 1.0);
        let apart = times[1] - times[0];
        assert!((apart - 22_800.0).abs() < 1000.0, "{apart} us");
    }
    let now = board.now() as f64 * 1e-3;
    assert!((now - 60_000.0..now).contains(&times[3]), "{} us", times[3]);

    // With a full window, r is half of a reading's, within the scatter of r: 20 % for four rows.
    tell(&mut board, "output r");
    let repeatability = |board: &mut VirtualBoard| {
        let lines = [(); 6].map(|()| line(board, "d mm r "));
        println!("{lines:?}");
        let numbers = lines.map(|line| line["d mm r ".len()..].parse::<f64>().expect("r"));
        statistics::mean(&numbers[2..])
    };
    let alone = repeatability(&mut board);
    tell(&mut board, "average moving 4");
    line(&mut board, "d mm r ");
    let share = repeatability(&mut board) / alone;
    assert!((0.35..0.7).contains(&share), "{share}");

    // A frame of four rows ends every 22.8 ms: of 44 frames a second, ten are sent.
    for command in ["rate 10", "units um", "output time distance"] {
        tell(&mut board, command);
    }
    let lines = [(); 6].map(|()| line(&mut board, "@ "));
    println!("{lines:#?}");
    let times = lines.each_ref().map(|line| number(line, "@ ", " d "));
    let apart = (times[5] - times[1]) / 4.0;
    assert!((apart - 100_000.0).abs() < 6000.0, "{apart} us");
    let off = number(&lines[5], " d ", " um") - 1e6 * DISTANCE;
    assert!(off.abs() < 50.0, "{off} um");
    tell(&mut board, "rate 0");

    // The firmware switches the output before it sends the line.
    assert_eq!(switching_output(&mut board), Some(false));
    tell(&mut board, "limits 799000 801000 um");
    line(&mut board, "@ ");
    line(&mut board, "@ ");
    assert_eq!(switching_output(&mut board), Some(true));

    // A target without a spot. Rows under way still have one. The output is on while a reading is held.
    tell(&mut board, "hold 2");
    line(&mut board, "@ ");
    board.set_light(spot_at(1800.0, 0.0));
    let ends = [" h 1", " h 2", " f no spot"].map(|part| {
        let line = await_line(&mut board, |line| line.contains(part));
        let level = switching_output(&mut board);
        assert_eq!(level, Some(part != " f no spot"), "{part}");
        line.at
    });
    assert!(ends.is_sorted());
    board.set_light(paper());
    line(&mut board, "@ ");
    let is_reading = |line: &str| line.contains(" d ");
    await_line(&mut board, is_reading);
    assert_eq!(switching_output(&mut board), Some(true));

    // Distances relative to a master, as comma-separated values with their header.
    board.send("master 5000\r\n");
    line(&mut board, "@ ");
    let of_master = await_line(&mut board, |line| line.contains(" z ")).text;
    let off = number(&of_master, " z ", " um") - 5000.0;
    assert!(off.abs() < 50.0, "{of_master}");
    assert_eq!(switching_output(&mut board), Some(false));
    tell(&mut board, "format csv");
    line(&mut board, "us,distance,z,h,fault");
    let values = await_line(&mut board, |line| line.ends_with(",1,0,"));
    assert_eq!(values.text.matches(',').count(), 4);
    tell(&mut board, "format text");
    tell(&mut board, "zero off");

    // A target that jumps by 200 mm: two spikes, then the new place.
    for command in ["average none", "hold 0", "spike-filter 1000 um"] {
        tell(&mut board, command);
    }
    line(&mut board, "@ ");
    board.set_light(of_scene(Scene::white_paper(), Target::at(DISTANCE + 0.2)));
    let is_far = |line: &str| line.contains(" d 100") || line.contains(" d 999");
    let mut jump = vec![];
    while !jump.last().is_some_and(|line: &String| is_far(line)) {
        jump.push(line(&mut board, "@ "));
        assert!(jump.len() < 20, "{jump:#?}");
    }
    println!("{jump:#?}");
    let spikes = jump.iter().filter(|line| line.contains(" f spike: "));
    assert!(spikes.count() >= 2, "{jump:#?}");
    board.set_light(paper());

    tell(&mut board, "defaults");
    Status::ask(&mut board).assert_nothing_lost();
    fresh_results(&mut board, 1);
}

/// A result that waits for the serial line while a setting changes is not held afterwards: it was measured
/// with the settings before. An echo that waits for the line lets results wait.
#[test]
fn results_of_before_a_change_are_dropped() {
    let mut board = measuring(1);
    tell(&mut board, "hold 1000");
    tell(&mut board, "echo on");
    // Three answers to `help` are more than the firmware's buffer holds: the third one waits for 0.3 s, and
    // the echo behind it waits for the line, 87 us a character. A backspace has an echo of three. So the echo
    // of these 64 bytes, which the firmware reads in one piece, takes 10 ms: longer than a row, 5.7 ms.
    board.send(&"help\r".repeat(3));
    run_ms(&mut board, 100);
    board.send(&format!("{}laser off\r", "x\u{8}".repeat(27)));
    let answer = board.run_until_line(|line| line.ends_with("laser off"), 3 * PATIENCE);
    answer.expect("the answer");
    assert_eq!(results(&mut board, 4), ["f laser off"; 4]);
}
