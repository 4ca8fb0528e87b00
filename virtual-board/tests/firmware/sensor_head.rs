//! Tests of the sensor head as the firmware drives it, at the highest rate of readings.

use rigless::soc::stm32f427::generated::spi1::{Register as Spi1, sr};
use slitrange::row::sensor_heads::TCD1304DG_LEAD_IN;
use virtual_board::sensor_head::limits;

use super::common::*;

const CENTRE: f64 = 1770.3;

/// The time from row to row, as the firmware states it, ns.
const ROW_PERIOD: f64 = 5_700_000.0;

/// When pixels are sampled, in parts of a pixel's time: least and most.
fn phases(rows: &[Row]) -> (f64, f64) {
    let least = rows.iter().map(|row| row.phase.0).fold(1.0, f64::min);
    let most = rows.iter().map(|row| row.phase.1).fold(0.0, f64::max);
    (least, most)
}

/// Each row has its lead-in, and begins a period after the row before.
fn assert_timing(rows: &[Row]) {
    for row in rows {
        assert_eq!(row.lead_in, TCD1304DG_LEAD_IN as i64);
    }
    for pair in rows.windows(2) {
        let apart = (pair[1].read_out - pair[0].read_out) as f64;
        assert!((apart - ROW_PERIOD).abs() <= 2_000.0, "{apart} ns");
    }
}

/// Rows come at the period that the firmware states, each pixel in its word and sampled in the middle of its
/// time. None is lost, with a reading for each row too. The laser is on as long as the row says.
#[test]
fn rows_come_on_time() {
    for (rows_of_frame, ms) in [(1, 1_000), (16, 500)] {
        let mut board = measuring(rows_of_frame);
        run_ms(&mut board, 200);
        keep_all_rows(&mut board);
        let before = board.statistics();
        board.take_lines();
        run_ms(&mut board, ms);
        let run = board.statistics().since(&before);
        let (count, busy) = (run.rows, 1.0 - run.asleep());
        let results = take_results(&mut board);
        let rows = kept_rows(&mut board);
        let rows = &rows[rows.len() - count as usize..];

        let (least, most) = phases(rows);
        println!("{count} rows, the core busy for {busy:.3} of the time");
        println!("sampled at {least:.3} to {most:.3} of a pixel's time");
        assert_timing(rows);
        let slower = slower_sampling();
        assert!(limits::HOLD_PHASE.contains(&least) && limits::HOLD_PHASE.contains(&most));
        // Elsewhere, DMA's latency and the core's load would change which rise of fM is the nearest.
        assert!(
            least > 0.6 - slower && most < 0.72 + slower,
            "{least} to {most}"
        );
        assert!(most - least < 0.1 + slower, "{least} to {most}");
        let off = count as f64 - ms as f64 * 1e6 / ROW_PERIOD;
        assert!(off.abs() <= 1.5, "{count} rows");
        for Row { exposure, .. } in rows {
            assert!(exposure.laser >= 10_000, "{exposure:?}");
        }
        assert_readings(&results);
        // A frame may be under way at either end.
        let results = results.len() as u64;
        assert!(results + 2 >= count / u64::from(rows_of_frame), "{results}");
        let status = Status::ask(&mut board);
        println!("a row took {} cycles", status.count("row cycles"));
        status.assert_nothing_lost();
        status.assert_none(&["rows late"]);
    }
}

#[test]
fn a_violated_limit_is_an_error_of_the_run() {
    let mut board = measuring(4);
    run_into_a_row(&mut board);
    stop_the_transfer(&mut board);
    let error = board.run_for(Duration::from_millis(30));
    let error = error.expect_err("a violation").to_string();
    assert!(error.contains("chip select was low for"), "{error}");
    assert!(board.finish().is_err());
}

/// The virtual board moves a read-out's words in batches, where rigless moves each word by itself. The
/// firmware must see the same rows at the same time, and send the same lines.
#[test]
fn words_in_batches_are_the_same_as_words_one_by_one() {
    let run = |word_by_word: bool| {
        // rigless's DMA counts a word when it ends.
        let conditions = with(full_speed(), |it| it.most_dma_latency = 0);
        let mut board = CleanBoard::power_on(spot_at(CENTRE, 1500.0), conditions);
        if word_by_word {
            with_processor(&mut board, |it| it.word_by_word = true);
        }
        keep_all_rows(&mut board);
        run_ms(&mut board, 400);
        (kept_rows(&mut board), take_texts(&mut board))
    };
    let (batches, lines) = run(false);
    let (single, single_lines) = run(true);

    assert!(batches.len() > 50, "{} rows", batches.len());
    assert_eq!(batches.len(), single.len());
    assert_eq!(lines, single_lines);
    let (mut apart, mut phases_apart) = (0, 0.0_f64);
    for (batch, single) in batches.iter().zip(&single) {
        let number = batch.number;
        let sent = |row: &Row| (row.words.clone(), row.counts.clone(), row.lead_in);
        assert!(sent(batch) == sent(single), "row {number}");
        let instants = |row: &Row| {
            let Row { exposure, .. } = row;
            [exposure.start, exposure.end, row.read_out, row.last_word]
        };
        for (batch, single) in instants(batch).into_iter().zip(instants(single)) {
            apart = apart.max(batch.abs_diff(single));
        }
        phases_apart = phases_apart.max((batch.phase.0 - single.phase.0).abs());
        phases_apart = phases_apart.max((batch.phase.1 - single.phase.1).abs());
    }
    println!("{} rows are the same", batches.len());
    println!("instants differ by {apart} ns at most, phases by {phases_apart:.4} pixels");
    // rigless begins the last two words without the remainder of a nanosecond. An interrupt that comes a
    // nanosecond later may be taken an instruction (6 ns) later, or after a turn of a loop. The compiler
    // makes turns of up to 15 instructions, 90 ns, of the loops that wait for a pulse. A pixel takes 1524 ns.
    assert!(apart <= 90, "{apart} ns");
    assert!(phases_apart <= 90.0 / 1524.0, "{phases_apart} pixels");
}

/// Silicon executes fewer instructions than it has clocks, because it waits for flash: at 84 million a second
/// each takes two clocks, at 56 million three. There no row is late, in a save too. On a still slower core
/// the edges of a row come too late: such a row must be rejected and counted, and must never move a centre.
#[test]
fn slow_cores_reject_late_rows_and_move_no_centre() {
    for (millions, is_too_slow) in [(168, false), (84, false), (56, false), (36, true)] {
        let conditions = conditions(|it| it.instructions_per_second = millions * 1_000_000);
        let mut board = CleanBoard::power_on(spot_at(CENTRE, 1500.0), conditions);
        if is_too_slow {
            // The head sees the edges of the rows that the firmware rejects.
            board.expect_violations();
        }
        await_banner(&mut board);
        set(&mut board, "rows 4");
        keep_all_rows(&mut board);
        run_ms(&mut board, 400);
        let (least, most) = phases(&kept_rows(&mut board));
        let status = Status::ask(&mut board);
        let late = status.count("rows late");
        let spread = number(&status.0.join("\n"), "spread ", " %");
        println!("{millions} million instructions a second: {late} late rows");
        println!("sampled at {least:.2} to {most:.2} of a pixel's time, spread {spread} %");
        if is_too_slow {
            assert!(late >= 10, "{late} late rows");
        } else {
            status.assert_none(&["rows late", "rows lost", "rows failed"]);
            // Each end is rounded down to 1 %. It is known to half a turn of a loop of up to 10 instructions,
            // and to 20 cycles of DMA.
            let turn = 100.0 * (40.0 + 10.0 * 168.0 / millions as f64) / 256.0;
            let off = spread - 100.0 * (most - least);
            assert!(off.abs() < 1.0 + turn, "{spread}");
            // Flash's data cache is off during each operation of a save, so silicon is then slower.
            assert_eq!(ask_in_a_pause(&mut board, "save nominal", PATIENCE), "save");
            Status::ask(&mut board).assert_none(&["rows late", "rows lost", "rows failed"]);
        }
        board.take_lines();
        run_ms(&mut board, 400);
        let mut readings = take_results(&mut board);
        readings.retain(|line| is_reading(line));
        for line in &readings {
            let error = number(line, "x ", " ") - CENTRE;
            assert!(error.abs() < 0.1, "{line}");
        }
        assert!(is_too_slow || readings.len() > 10, "{readings:#?}");
    }
}

/// If DMA fed SPI late, SCLK would pause, and all later words would show a pixel that lies further on. The
/// firmware sees a pause of one word by the read-out's duration. Such a row must not move a centre.
#[test]
fn rows_with_a_gap_between_two_words_are_rejected_and_counted() {
    const WORD: Duration = Duration::from_nanos(1524);
    let mut board = measuring_in(spot_at(CENTRE, 1500.0), 4);
    fresh_results(&mut board, 2);
    // A pause moves the time at which pixels are sampled, in the rows that the firmware rejects.
    board.expect_violations();
    let mut late_before = 0;
    let shortest = (137.0 + 16.0 * cycles_an_instruction()) * 1e9 / 168e6;
    // From the first word that counts to the pixels after the spot, and a long pause.
    let (first, spot, last) = (21, 1805, 3600);
    for (word, pause) in [
        (first, WORD),
        (1000, WORD),
        (spot, WORD),
        // 153 core cycles, more on a slower core: see `has_gap` in src/heads/read_out.rs.
        (last, Duration::from_nanos(shortest.ceil() as u64)),
        (first + 30, 7 * WORD),
    ] {
        board.pause_words(Some((word, pause))).expect("a gap");
        run_ms(&mut board, 20);
        board.take_lines();
        let before = board.statistics().rows;
        run_ms(&mut board, 100);
        let rows = board.statistics().rows - before;
        let lines = take_texts(&mut board);
        board.pause_words(None).expect("no gap");
        // The row under way still has its gap.
        run_ms(&mut board, 12);
        let late = Status::ask(&mut board).count("rows late");
        let more = late - late_before;
        println!("a pause after word {word}: {rows} rows, {more} late");
        assert!(more >= rows && rows >= 15, "{late} late rows");
        late_before = late;
        assert!(!lines.iter().any(|line| is_reading(line)), "{lines:#?}");
        let lines = fresh_results(&mut board, 2);
        let error = number(&lines[0], "x ", " ") - CENTRE;
        assert!(error.abs() < 0.1, "{lines:#?}");
    }
    let status = Status::ask(&mut board);
    status.assert_none(&["rows lost", "rows failed"]);
    assert_eq!(status.count("rows late"), late_before, "{status:#?}");
}

/// SPI1 says so, and DMA would wait for the word for ever. The row must not be used. The next one is good.
#[test]
fn a_lost_word_costs_its_row_only() {
    let mut board = measuring(4);
    for lost in 1..=5 {
        run_into_a_row(&mut board);
        with_processor(&mut board, |it| {
            let registers = it.converter_registers();
            registers.set(Spi1::Sr, registers.get(Spi1::Sr) | sr::OVR.mask());
        });
        run_ms(&mut board, 10);
        let status = Status::ask(&mut board);
        assert_eq!(status.count("rows failed"), lost);
        status.assert_none(&["rows late", "rows lost", "fault sensor silent"]);
    }
    assert_readings(&fresh_results(&mut board, 2));
}
