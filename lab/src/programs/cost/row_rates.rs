//! The rates of rows that the chip sustains, if the sensor has no rate limit of its own.
//!
//! The firmware runs on the virtual board, as it is flashed. The highest rate without a lost row is found by
//! bisection. All that the core executes is traced: the computation of the rows, and beside it the read-out,
//! interrupts, executor, text and serial line.

use answers_on_chip::mailbox::{self, Header};
use anyhow::{Context, Result, bail};
use simulator::scene::{Scene, Spot};
use std::fmt::Write as _;
use std::time::Duration;
use virtual_board::row_rate::{self, Cost};
use virtual_board::{Firmware, PIXELS, VirtualBoard};

use crate::programs::cost::chip::cycles::{Model, Range};
use crate::programs::cost::chip::program::Program;

/// The core's clock.
const CLOCK_HZ: f64 = 168e6;

/// Rows in a frame: the default, and the most.
const FRAMES: [u16; 2] = [16, 64];

/// Pixels of the sensor head, and of a shorter one.
const LONG: u16 = 3648;
const SHORT: u16 = 2048;

/// The function that measures a row of any length, as Rust names it.
const MEASURE_ANY_ROW: &str = "answers_on_chip::answers::measure_any_row";

/// Rows of each trial of the bisection: 12 of the longest frames.
const TRIAL: u64 = 768;

/// A rate that the firmware sustains in any case.
const SUSTAINED: f64 = 800.0;

/// The bisection begins between these parts of the rate by instructions. The firmware sustains the first
/// rate and not the second.
const TRIED: [f64; 2] = [0.4, 1.1];

/// Rows a second, by what they are counted from.
#[derive(Clone, Copy, Debug)]
struct Rates {
    by_instructions: f64,
    by_cycles: f64,
    by_most_cycles: f64,
}

/// What was found for a number of rows in a frame.
#[derive(Debug)]
pub struct RowRate {
    rows: u16,
    /// The highest rate on the virtual board without a lost row.
    highest: f64,
    /// Instructions of a row from its words to its centre, and beside that.
    computing: f64,
    beside: f64,
    long: Rates,
    short: Rates,
}

/// Finds the rates.
///
/// # Errors
/// A build or the emulation fails.
pub fn measure() -> Result<Vec<RowRate>> {
    let firmware = Firmware::build()?;
    let program = Program::of(&firmware)?;
    let model = Model::of(&program);
    let less = less_for_fewer_pixels().context("rows of fewer pixels on the chip")?;
    FRAMES
        .into_iter()
        .map(|rows| {
            // At a low rate, so that nothing waits for a turn and no line is dropped.
            let cost = row_rate::cost(&firmware, SUSTAINED, rows, (256 / rows).into())?;
            let [from, to] = TRIED.map(|part| part * CLOCK_HZ / cost.instructions);
            let highest = row_rate::highest(&firmware, rows, from, to, TRIAL)?;
            Ok(row_rate_of(
                rows,
                highest,
                &cost,
                model.range(&cost.path),
                &less,
            ))
        })
        .collect()
}

fn row_rate_of(rows: u16, highest: f64, cost: &Cost, cycles: Range, less: &Less) -> RowRate {
    let [likely, most] = [cycles.likely, cycles.high].map(|cycles| cycles as f64 / cost.rows);
    let following = f64::from(rows - 1) * less.following;
    let fewer = (less.first + following) / f64::from(rows);
    // Fewer pixels save as large a part of the cycles as of the instructions.
    let part = 1.0 - fewer / cost.instructions;
    let rates = |part: f64| Rates {
        by_instructions: CLOCK_HZ / (part * cost.instructions),
        by_cycles: CLOCK_HZ / (part * likely),
        by_most_cycles: CLOCK_HZ / (part * most),
    };
    RowRate {
        rows,
        highest,
        computing: cost.computing,
        beside: cost.instructions - cost.computing,
        long: rates(1.0),
        short: rates(part),
    }
}

/// Instructions that a row of [`SHORT`] pixels takes less than one of [`LONG`].
#[derive(Debug)]
struct Less {
    /// The first row of a frame.
    first: f64,
    /// A row behind it.
    following: f64,
}

/// Counts the same spot on rows of both lengths. The program of `answers-on-chip` takes rows of any length,
/// and measures them with each estimator.
fn less_for_fewer_pixels() -> Result<Less> {
    let firmware = Firmware::build_package("answers-on-chip")?;
    let function = Program::of(&firmware)?
        .named(MEASURE_ANY_ROW)
        .with_context(|| format!("the chip's program has no function {MEASURE_ANY_ROW}"))?;
    let mut board = VirtualBoard::power_on(&firmware, Box::new(|_| vec![0.0; PIXELS]))?;
    board.run_for(Duration::from_millis(2))?;
    board.trace_calls_of(function);
    let [long, short] = [LONG, SHORT].map(|pixels| instructions(&firmware, &mut board, pixels));
    let (long, short) = (long?, short?);
    Ok(Less {
        first: (long[0] - short[0]) as f64,
        following: (long[1] - short[1]) as f64,
    })
}

/// Instructions of the first row and of the row behind it, with the default estimator.
fn instructions(firmware: &Firmware, board: &mut VirtualBoard, pixels: u16) -> Result<[i64; 2]> {
    let scene = Scene {
        spot: Some(Spot {
            width: 8.6,
            counts_per_second: 2000.0,
        }),
        ..Scene::white_paper()
    };
    let mut words: Vec<u32> = vec![];
    for number in 0..2 {
        let row = scene.row_with_centre(number, 1000.0, 1.0);
        let row: Vec<u16> = row
            .iter()
            .skip(32)
            .map(|&counts| 4095 - counts as u16)
            .collect();
        let header = Header {
            pixels,
            bits: 12,
            first: number == 0,
            falling: true,
            shot_variance_per_count_q16: 6554,
        };
        words.extend(mailbox::words(header, &row[..pixels.into()]));
    }
    words.push(0);
    let (asked, rows) = (firmware.address_of("ASKED")?, firmware.address_of("ROWS")?);
    for (address, word) in (rows..).step_by(4).zip(words) {
        board.write_word(address, word)?;
    }
    board.take_calls();
    board.write_word(asked, 1)?;
    for _ in 0..1000 {
        board.run_for(Duration::from_millis(1))?;
        if board.read_word(asked)? == 0 {
            break;
        }
    }
    let calls = board.take_calls();
    let [first, following] = calls.as_slice() else {
        bail!("{} calls for two rows", calls.len());
    };
    Ok([first, following].map(|call| call.instructions() as i64))
}

/// The table for a terminal or a page.
pub fn markdown(rates: &[RowRate]) -> String {
    let mut text = String::from("| |");
    for rate in rates {
        // Writing to a string never fails.
        let _ = write!(text, " {} rows a frame |", rate.rows);
    }
    text += "\n|---|";
    text += &"---:|".repeat(rates.len());
    text.push('\n');
    let mut line = |name: &str, figure: &dyn Fn(&RowRate) -> f64| {
        let _ = write!(text, "| {name} |");
        for rate in rates {
            let _ = write!(text, " {:.0} |", figure(rate));
        }
        text.push('\n');
    };
    line(
        "instructions of a row from its words to its centre, mean over a frame",
        &|it| it.computing,
    );
    line(
        "instructions of a row beside that, mean over a frame",
        &|it| it.beside,
    );
    line(
        "rows a second, 3648 pixels: highest rate without a lost row",
        &|it| it.highest,
    );
    line("rows a second, 3648 pixels, by instructions", &|it| {
        it.long.by_instructions
    });
    line("rows a second, 3648 pixels, by likely cycles", &|it| {
        it.long.by_cycles
    });
    line("rows a second, 3648 pixels, by the most cycles", &|it| {
        it.long.by_most_cycles
    });
    line("rows a second, 2048 pixels, by instructions", &|it| {
        it.short.by_instructions
    });
    line("rows a second, 2048 pixels, by likely cycles", &|it| {
        it.short.by_cycles
    });
    line("rows a second, 2048 pixels, by the most cycles", &|it| {
        it.short.by_most_cycles
    });
    text
}
