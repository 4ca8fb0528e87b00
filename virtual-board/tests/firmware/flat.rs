//! Tests of `flat`: the map of the pixels lowers the error of a sensor whose pixels differ, and survives
//! power cycles and power cuts.

use simulator::scene::{FixedPattern, Response};

use super::common::*;
use super::kept;

/// Longer than 256 rows or an erase take.
const TAKING: Duration = Duration::from_secs(3);

fn scene() -> Scene {
    Scene {
        response: Some(Response { deviation: 0.02 }),
        fixed_pattern: Some(FixedPattern { counts: 5.0 }),
        ..Scene::white_paper()
    }
}

fn paper(distance: f64) -> LightSource {
    of_scene(scene(), Target::at(distance))
}

fn even(counts: f64) -> LightSource {
    let ambient = format!("ambient.counts_per_second = {}", counts / scene().exposure);
    let lit = scene().listing(&ambient).expect("a scene");
    let scene = with(lit, |it| it.spot = None);
    of_scene(scene, Target::at(0.8))
}

fn paused(board: &mut VirtualBoard, command: &str) -> String {
    ask_in_a_pause(board, command, TAKING)
}

fn take(board: &mut VirtualBoard) -> [String; 2] {
    board.set_light(even(0.0));
    let dark = paused(board, "flat dark");
    board.set_light(even(2000.0));
    [dark, paused(board, "flat lit")]
}

fn error(board: &mut VirtualBoard) -> f64 {
    let simulation = Simulation::new(scene());
    statistics::rms([0.6, 0.7, 0.8, 0.9, 1.0].map(|distance| {
        board.set_light(paper(distance));
        let reading = fresh_results(board, 1).remove(0);
        let error = number(&reading, " x ", " a ") - simulation.true_centre(0, distance);
        println!("{reading} {error:+.4}");
        error
    }))
}

/// The cycles of a row that is neither the first nor the last of its frame: the least of several rows. On the
/// virtual board an instruction takes a cycle.
fn cycles_of_following_row(board: &mut VirtualBoard) -> i64 {
    let ask = |_| {
        board.run_for(Duration::from_millis(13)).expect("it runs");
        Status::ask(board).count("row cycles") as i64
    };
    (0..8).map(ask).min().expect("eight rows")
}

/// A map corrects less than 200 pixels of a following row of this scene, at less than 20 instructions each.
const MOST_CYCLES_OF_MAP: i64 = 4000;

fn shown(board: &mut VirtualBoard) -> Vec<String> {
    ask_until(board, "flat", |line| line.starts_with("flat stored "))
}

#[test]
fn a_map_lowers_the_error_and_survives_a_power_cycle() {
    let mut board = measuring_in(paper(0.8), 16);
    assert_eq!(shown(&mut board), ["flat none", "flat stored none"]);
    let refused = ask(&mut board, "flat lit");
    assert!(refused.starts_with("E20 "), "{refused}");
    for command in ["flat on", "flat off", "flat save"] {
        assert!(ask(&mut board, command).starts_with("E19 "), "{command}");
    }
    let before = error(&mut board);
    let [dark, lit] = take(&mut board);
    println!("{dark}\n{lit}");
    assert!((number(&dark, "flat dark ", " counts") - 300.0).abs() < 2.0);
    // The scene's exposure is 5 ms, the firmware's 5.7 ms.
    assert!((number(&lit, "flat lit ", " counts") - 2575.0).abs() < 15.0);
    let after = error(&mut board);
    let with = cycles_of_following_row(&mut board);
    println!("before {before:.4} px, after {after:.4} px");
    assert!(before > 0.015 && after < 0.008 && after < before / 3.0);
    set(&mut board, "flat off");
    let without = error(&mut board);
    let without_map = cycles_of_following_row(&mut board);
    println!("{with} cycles a row with the map, {without_map} without");
    assert!(with - without_map < MOST_CYCLES_OF_MAP);
    assert!((without - before).abs() < 0.008, "{without}");
    set(&mut board, "flat on");
    assert_eq!(paused(&mut board, "flat save"), "flat save");
    let lines = shown(&mut board);
    println!("{lines:#?}");
    assert_eq!(lines[0], "flat on");
    assert_eq!(lines[3], "flat stored same");
    let status = Status::ask(&mut board);
    status.assert_none(&["rows failed", "fault sensor silent"]);
    // While the map is computed, no reading is due.
    assert!(status.count("rows lost") <= 1, "{status:#?}");
    assert_no_reset(&mut board);

    let mut board = power_cycle(board, paper(0.8));
    set(&mut board, "rows 16");
    assert_eq!(shown(&mut board), lines);
    assert!(error(&mut board) < 0.008);
    // A dark row takes the place of the map; `flat on` brings it back from flash.
    board.set_light(even(0.0));
    paused(&mut board, "flat dark");
    assert_eq!(shown(&mut board)[0], "flat none");
    set(&mut board, "flat on");
    assert_eq!(shown(&mut board), lines);
    // The laser's spot is no even light.
    board.set_light(paper(0.8));
    let refused = paused(&mut board, "flat dark");
    assert!(refused.starts_with("E20 "), "{refused}");
    assert_eq!(shown(&mut board), lines, "the map is as it was");
    assert_eq!(paused(&mut board, "flat none"), "flat none");
    assert_eq!(shown(&mut board), ["flat none", "flat stored none"]);
    let mut board = power_cycle(board, paper(0.8));
    assert_eq!(shown(&mut board), ["flat none", "flat stored none"]);
}

#[test]
fn a_power_cut_leaves_the_old_map_or_the_new_one() {
    let (mut board, _) = boot(paper(0.8));
    take(&mut board);
    assert_eq!(paused(&mut board, "flat save"), "flat save");
    let (_, old) = kept::map_in(&board.flash().contents());
    let old = old.expect("a map");
    // The same sensor with other noise.
    take(&mut board);
    let other = shown(&mut board);
    assert_eq!(other.last().map(String::as_str), Some("flat stored other"));
    board.flash().take_history();
    assert_eq!(paused(&mut board, "flat save"), "flat save");
    let history = board.flash().take_history();
    let operations = history.operations.len();
    let (stored, new) = kept::map_in(&history.after(operations));
    let new = new.expect("a map");
    assert_eq!(stored, StoredMap::Newest);
    assert!(old != new, "noise");
    let mut interrupted = 0;
    let near_the_ends = [1, 2, 3, operations - 1];
    for count in (0..operations).step_by(331).chain(near_the_ends) {
        for contents in [history.after(count), history.torn_after(count, 7)] {
            let (stored, map) = kept::map_in(&contents);
            let map = map.expect("a map");
            assert!(map == old || map == new, "{count}");
            interrupted += usize::from(stored == StoredMap::Older && map == old);
        }
    }
    assert!(interrupted > 10, "{interrupted}");

    let flash = SharedFlash::holding(history.after(operations / 2));
    let mut board = boot_with(&flash, paper(0.8));
    let lines = shown(&mut board);
    println!("{lines:#?}");
    assert_eq!(lines[0], "flat on");
    assert!(lines[3].starts_with("flat fault the last save is unusable"));
    assert_eq!(lines[4], "flat stored same");
}

#[test]
fn a_map_that_is_damaged_or_of_a_later_version_is_not_used() {
    let (mut board, _) = boot(paper(0.8));
    take(&mut board);
    assert_eq!(paused(&mut board, "flat save"), "flat save");
    let whole = board.flash().contents();
    let start = 2 * SECTOR_BYTES;
    // A bit of an entry in the first sector of the map; the version and its complement, 1 to 2.
    for (flips, fault) in [
        (&[(5000, 0x10)][..], "the saved map cannot be used: "),
        (
            &[(2, 3), (3, 3)],
            "the saved map has version 2, this firmware reads 1: update the firmware, or ",
        ),
    ] {
        let mut contents = whole.clone();
        for &(at, bits) in flips {
            contents.flip_bits(start + at, bits);
        }
        let mut board = boot_with(&SharedFlash::holding(contents.clone()), paper(0.8));
        let lines = shown(&mut board);
        println!("{lines:#?}");
        assert_eq!(lines[0], "flat none");
        assert!(lines[1].starts_with(&format!("flat fault {fault}")));
        assert_eq!(lines[2], "flat stored unusable");
        assert!(is_reading(&fresh_results(&mut board, 1)[0]));
        if flips.len() == 2 {
            // A save leaves the map of later firmware.
            take(&mut board);
            assert_eq!(paused(&mut board, "flat save"), "flat save");
            let later = |contents: Contents| contents.bytes()[start..][..SECTOR_BYTES].to_vec();
            assert!(later(board.flash().contents()) == later(contents));
        }
    }
}
