//! Tests of `row`: the pixels that come out of the serial line are those that the sensor head saw. For the
//! words of this row, the core on the PC gives the same centre or fault.

use std::ops::Range;

use slitrange::base::exposure::Exposure;
use slitrange_device::protocol::row_lines::{RowExposure, RowHead, RowPart};
use virtual_board::Exposure as Light;

use super::comb::paper_behind_a_comb;
use super::common::*;

/// 114 lines of some 110 characters at 115,200 baud take 1.1 s.
const SENDING: Duration = Duration::from_secs(3);

/// The default settings with a change.
fn settings(change: impl FnOnce(&mut Settings)) -> Settings {
    let mut settings = Settings::default();
    change(&mut settings);
    settings
}

/// What `row` answers.
struct Answer {
    part: RowPart,
    /// The lines before the pixels.
    head: Vec<String>,
    first: usize,
    counts: Vec<u16>,
}

impl Answer {
    fn ask(board: &mut VirtualBoard, part: RowPart) -> Self {
        board.take_lines();
        board.send(&format!("{part}\r\n"));
        let line = board.run_until_line(|line| line == ROW_END, SENDING);
        line.expect("the row's end");
        let mut answer = Self {
            part,
            head: vec![],
            first: 0,
            counts: vec![],
        };
        // What was under way comes before the answer, and nothing comes in between.
        let lines = take_texts(board).into_iter();
        let lines = lines.skip_while(|line| is_result(line));
        for line in lines.take_while(|line| line != ROW_END) {
            match RowPixels::parse(&line) {
                Some(pixels) => {
                    if answer.counts.is_empty() {
                        answer.first = pixels.first.into();
                    }
                    let next = answer.first + answer.counts.len();
                    assert_eq!(usize::from(pixels.first), next);
                    answer.counts.extend(pixels.counts);
                }
                None => answer.head.push(line),
            }
        }
        answer
    }

    fn window(&self) -> Range<f64> {
        let end = self.first + self.counts.len();
        self.first as f64..end as f64
    }

    /// For how long the laser was on, as the answer says.
    fn exposure(&self) -> RowExposure {
        let words = self.head[0].split_once(" exposure ").expect("an exposure");
        RowExposure::parse(words.1.split(' ').next().expect("a word")).expect("an exposure")
    }

    /// Finds the row among those that the sensor head gave, and what the core on this PC makes of its words.
    fn on_this_pc(&self, board: &mut VirtualBoard, settings: Settings) -> Vec<String> {
        let pixels = self.first..self.first + self.counts.len();
        let geometry = sensor_heads::tcd1304dg();
        let is_this = |words: &[u16]| {
            let light = geometry.row(words).expect("a row").light();
            let sent = light.slice(pixels.clone()).expect("pixels");
            sent.iter().eq(self.counts.iter().copied())
        };
        let row = board.head(|head| head.rows().find(|row| is_this(&row.words)).cloned());
        let row = row.expect("a row with these pixels");
        // The time for which the laser's pin was high is within the clock's microsecond.
        let exposure = match self.exposure() {
            RowExposure::On(exposure) => Some(exposure),
            RowExposure::Off => None,
            RowExposure::Unknown => panic!("the firmware knows its light"),
        };
        let on_us = row.exposure.laser as f64 / 1e3;
        println!("{exposure:?}, the laser was on for {on_us} us");
        assert!((f64::from(exposure.map_or(0, Exposure::us)) - on_us).abs() < 2.0);
        let mut words = row.words;
        let measured = Measurement::new(geometry.clone(), settings.options())
            .measure_alone(&mut words, exposure, None);
        let row = geometry.row(&words).expect("a row");
        let head = RowHead::new(
            self.part,
            &row,
            self.exposure(),
            &measured,
            settings.searched(),
        );
        head.to_string().split("\r\n").map(String::from).collect()
    }
}

/// Asks for a part of a row, whose head must be what the core on this PC makes of the row. Gives the answer.
fn answer_as_here(board: &mut VirtualBoard, part: RowPart, settings: Settings) -> Answer {
    let answer = Answer::ask(board, part);
    println!("{:#?}", answer.head);
    assert_eq!(answer.head, answer.on_this_pc(board, settings));
    answer
}

fn boot_keeping(light: LightSource) -> CleanBoard {
    let (mut board, _) = boot(light);
    keep_all_rows(&mut board);
    board
}

/// No row was lost while a row was sent, and readings stream again.
fn assert_streaming(mut board: CleanBoard) {
    assert_readings(&fresh_results(&mut board, 2));
    Status::ask(&mut board).assert_nothing_lost();
}

#[test]
fn a_whole_row_is_sent_with_what_the_core_makes_of_it() {
    let mut board = boot_keeping(paper());
    let answer = answer_as_here(&mut board, RowPart::Whole, Settings::default());
    assert_eq!(answer.first, 0);
    assert_eq!(answer.counts.len(), sensor_heads::tcd1304dg().light.len());
    assert!(answer.head[1].starts_with("x "));
    assert_streaming(board);
}

#[test]
fn a_window_holds_the_spot_and_nothing_else() {
    let mut board = boot_keeping(paper());
    let answer = answer_as_here(&mut board, RowPart::Window, Settings::default());
    let centre = number(&answer.head[1], "x ", " u");
    let half = 6.0 * number(&answer.head[1], " w ", " o");
    let window = answer.window();
    assert!((window.start - (centre - half)).abs() <= 1.0, "{window:?}");
    assert!((window.end - (centre + half)).abs() <= 1.0, "{window:?}");
    assert_streaming(board);
}

#[test]
fn the_window_of_a_comb_holds_all_its_images() {
    let mut board = boot_keeping(paper_behind_a_comb());
    set(&mut board, "slits comb");
    let settings = settings(|it| it.slits = Slits::Comb);
    let answer = answer_as_here(&mut board, RowPart::Window, settings);
    let slits = answer.head[2].strip_prefix("slits ").expect("slits");
    let place = |slit: &str| slit.split('/').next()?.parse().ok();
    let places: Vec<f64> = slits.split(' ').filter_map(place).collect();
    assert!(places.len() >= 12);
    let window = answer.window();
    let all = places.iter().all(|place| window.contains(place));
    assert!(all, "{window:?}: {places:?}");
    assert_streaming(board);
}

/// Readings of single rows nearly fill the line. None of them waits behind the pixels, and none is dropped.
#[test]
fn readings_of_single_rows_go_on_at_once() {
    let mut board = boot_keeping(paper());
    set(&mut board, "rows 1");
    Answer::ask(&mut board, RowPart::Whole);
    let (sent, rows) = (board.now(), board.statistics().rows);
    let next = await_line(&mut board, is_reading);
    let waited = Duration::from_nanos(next.at - sent);
    println!("the next reading came after {waited:?}");
    assert!(waited < Duration::from_millis(50));
    fresh_results(&mut board, 50);
    assert!(board.statistics().rows - rows <= 65);
    assert_streaming(board);
}

/// A range is sent with a spot, with a fault and without light. Each head states the row's own exposure.
#[test]
fn a_range_has_the_exposure_of_its_row() {
    let mut board = boot_keeping(paper());
    let (first, last) = (1700, 1839);
    let range = RowPart::Range { first, last };
    let (longest, short) = (
        Exposure::LONGEST,
        Exposure::from_us(187).expect("an exposure"),
    );
    for (line, laser, fixed, exposure) in [
        ("exposure 5600", true, longest, RowExposure::On(longest)),
        ("exposure 187", true, short, RowExposure::On(short)),
        ("laser off", false, short, RowExposure::Off),
    ] {
        set(&mut board, line);
        // The row before was exposed when the setting changed.
        run_ms(&mut board, 100);
        let settings = settings(|it| (it.laser, it.exposure) = (laser, ExposureMode::Fixed(fixed)));
        let answer = answer_as_here(&mut board, range, settings);
        assert_eq!(answer.exposure(), exposure);
        assert_eq!((answer.first, answer.counts.len()), (1700, 140));
    }
    set(&mut board, "laser on");
    let (first, last) = (3640, u16::MAX);
    let answer = Answer::ask(&mut board, RowPart::Range { first, last });
    assert_eq!((answer.first, answer.counts.len()), (3640, 8));
    let error = "E3 out of range, expected row [window|FIRST LAST]";
    assert_eq!(ask(&mut board, "row 1839 1700"), error);
}

/// A row without a spot can be looked at, which is when one wants to. Its window is empty.
#[test]
fn rows_without_a_spot_and_without_a_sensor_are_answered() {
    let dark = |_: &Light| vec![300.0; PIXELS];
    let mut board = boot_keeping(Box::new(dark));
    let answer = Answer::ask(&mut board, RowPart::Whole);
    assert!(answer.counts.iter().all(|&count| count == 300));
    assert_eq!(answer.counts.len(), sensor_heads::tcd1304dg().light.len());
    assert!(answer.head[1].starts_with("f "), "{:?}", answer.head);
    let window = Answer::ask(&mut board, RowPart::Window);
    assert!(window.head[0].starts_with("row pixels 3648 first 0 count 0 "));
    assert!(window.counts.is_empty());

    board.set_light(paper());
    board.open_line(Some(OpenLine::Zeros));
    let silent = Answer::ask(&mut board, RowPart::Whole);
    println!("{:#?}", silent.head);
    assert_eq!(silent.head[1], "f sensor silent");
    let level = silent.counts[0];
    println!("without a sensor all pixels have {level} counts");
    assert!(silent.counts.iter().all(|&count| count == level));
    board.open_line(None);
    fresh_results(&mut board, 2);
}
