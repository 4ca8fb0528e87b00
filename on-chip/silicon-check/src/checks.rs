//! The checks, in the order in which they run.

use core::sync::atomic::Ordering;

use cortex_m::peripheral::DWT;
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer};
use embedded_storage_async::nor_flash::{NorFlash as _, ReadNorFlash as _};
use slitrange::centre::Estimator;
use slitrange_device::protocol::info::Clock;
use slitrange_device::protocol::status::StartCause;
use static_cell::ConstStaticCell;

use crate::board::processor::CORE_HZ;
use crate::board::{self, CalibrationFlash, SerialPort};
use crate::counters::COUNTERS;
use crate::estimators::{self, Load};
use crate::heads::{CYCLES_A_MASTER_CLOCK, ROW_PERIOD, WORDS};
use crate::kept::Word;
use crate::pins::{self, free_rows};
use crate::report::{Report, text};
use crate::rows::ROWS;
use crate::wires::{self, SEEN};

/// Rows to check, unless a test asks for fewer: 57 s.
const ROWS_TO_CHECK: u32 = 10_000;

/// SCLK's periods in a row.
const EDGES: u32 = 16 * WORDS as u32;

/// The results that mean nothing on the virtual board.
const VIRTUAL: [&str; 4] = [
    "note: an instruction takes one cycle, so this is the virtual board. There,",
    "note: t1, t3, t4 are those of a faster core; SCLK time, erase, program and",
    "note: watchdog are assumed times; cycles are instructions; MISO and the wires",
    "note: have no capacitance.",
];

#[embassy_executor::task]
pub async fn run(
    serial: SerialPort,
    mut flash: CalibrationFlash,
    clock: Clock,
    started_by: StartCause,
) {
    let (tx, mut rx) = serial;
    let mut report = Report::new(tx);
    let waited = Word::Waits.is_written();
    Word::Waits.set(0);
    if waited && started_by == StartCause::Watchdog {
        report.passed = Word::Passed.get();
        report.failed = Word::Failed.get();
        report.skipped = Word::Skipped.get();
        report_watchdog(&mut report, Some(Word::Waited.get())).await;
        end(&mut report).await
    }
    let rows = if Word::RowsWritten.is_written() {
        Word::Rows.get()
    } else {
        ROWS_TO_CHECK
    };
    let head = text!("silicon-check on {}, {rows} rows", board::NAME);
    report.line(&head).await;
    if an_instruction_takes_a_cycle() {
        for line in VIRTUAL {
            report.line(line).await;
        }
    }
    wires::init();
    check_clock(&mut report, clock).await;
    pins::check_chip(&mut report).await;
    pins::check_driver_enable(&mut report).await;
    pins::check_trigger(&mut report).await;
    pins::check_reception(&mut report, &mut rx).await;
    let mut load = Load::new();
    if check_rows(&mut report, rows, &mut load).await {
        check_miso(&mut report).await;
        check_flash(&mut report, &mut flash).await;
    } else {
        for name in [
            "MISO low",
            "MISO high",
            "MISO open",
            "MISO fM",
            "erase",
            "program",
        ] {
            report.skip(name, "rows").await;
        }
    }
    check_estimators(&mut report, &mut load).await;
    pins::check_laser(&mut report).await;
    wait_for_watchdog(&mut report).await;
    end(&mut report).await
}

/// Prints the last line, and takes rows for ever.
async fn end(report: &mut Report) -> ! {
    report.end().await;
    loop {
        take_rows().await;
    }
}

/// Whether this core takes a cycle for every instruction. Silicon takes more for a branch, in every try. The
/// emulator's counter may be some instructions late in one.
fn an_instruction_takes_a_cycle() -> bool {
    const TURNS: u32 = 32;
    (0..8).any(|_| cycles_of_turns(TURNS) == 2 * TURNS + 1)
}

/// The cycles of a loop of two instructions, and of the load before it.
#[inline(never)]
fn cycles_of_turns(turns: u32) -> u32 {
    cortex_m::interrupt::free(|_| {
        let (before, after): (u32, u32);
        // SAFETY: reads the cycle counter twice, and counts a register down.
        unsafe {
            core::arch::asm!(
                "ldr {before}, [{counter}]",
                "2:",
                "subs {turns}, {turns}, #1",
                "bne 2b",
                "ldr {after}, [{counter}]",
                counter = in(reg) &raw const (*DWT::PTR).cyccnt,
                turns = inout(reg) turns => _,
                before = out(reg) before,
                after = out(reg) after,
                options(nostack),
            );
        }
        after.wrapping_sub(before)
    })
}

/// Whether the board started with the clock from the ST-LINK.
async fn check_clock(report: &mut Report, clock: Clock) {
    let found = match clock {
        Clock::External => "8 MHz from the ST-LINK",
        Clock::Internal => {
            "the ST-LINK gave no clock for 3 s, so the chip's own oscillator is used"
        }
    };
    let look_at = "if you took the clock away: this line must fail, and all others pass";
    let passes = matches!(clock, Clock::External);
    report.check("clock", passes, found, look_at).await;
}

fn ns(cycles: u32) -> u32 {
    (u64::from(cycles) * 1_000_000_000 / u64::from(CORE_HZ)) as u32
}

/// The pulses and the clocks of rows, while the core computes all the time. Returns whether the rows came.
async fn check_rows(report: &mut Report, rows: u32, load: &mut Load) -> bool {
    let master_clock = wires::measure_master_clock();
    free_rows().await;
    let before = Counts::now();
    wires::start();
    let patience = ROW_PERIOD * (rows + rows / 4 + 100);
    let start = Instant::now();
    while Counts::since(&before).pulses < rows && start.elapsed() < patience {
        load.compute(Estimator::default());
        COUNTERS.results.add();
        free_rows().await;
    }
    wires::stop();
    let counts = Counts::since(&before);

    let (read, late) = (counts.rows, counts.late);
    // The last one may be under way.
    let has_rows = read + 1 >= rows && counts.bad() == 0;
    let found = text!(
        "{read} read, {late} late, {} failed, {} lost, with the core always busy",
        counts.failed,
        counts.lost
    );
    let look_at = "late: the core is too slow; failed: SPI or DMA; lost: the estimator is too slow";
    report.check("rows", has_rows, &found, look_at).await;
    let has_master_clock = check_master_clock(report, master_clock).await;
    check_pulses(report, counts.pulses, has_master_clock).await;
    // SCLK runs in a late row, too.
    check_sclk(report, read + late).await;
    has_rows
}

#[derive(Default)]
struct Counts {
    pulses: u32,
    rows: u32,
    late: u32,
    failed: u32,
    lost: u32,
}

impl Counts {
    fn since(before: &Self) -> Self {
        Self {
            pulses: COUNTERS.pulses.get().wrapping_sub(before.pulses),
            rows: COUNTERS.rows.get().wrapping_sub(before.rows),
            late: COUNTERS.rows_late.get().wrapping_sub(before.late),
            failed: COUNTERS.rows_failed.get().wrapping_sub(before.failed),
            lost: COUNTERS.rows_lost.get().wrapping_sub(before.lost),
        }
    }

    fn now() -> Self {
        Self::since(&Self::default())
    }

    /// Rows that were not read.
    fn bad(&self) -> u32 {
        self.late + self.failed + self.lost
    }

    /// Whether as many rows came as were due in this time.
    fn are_whole(&self, time: Duration) -> bool {
        let due = (time.as_micros() / ROW_PERIOD.as_micros()) as u32;
        self.bad() == 0 && self.rows + 1 >= due
    }
}

/// Returns whether fM is as it must be.
async fn check_master_clock(report: &mut Report, clock: Option<wires::MasterClock>) -> bool {
    const LOOK_AT: &str = "look at the wire PE9 (D6) to PC7 (D21)";
    let Some(clock) = clock else {
        report.check("fM", false, "no edge came", LOOK_AT).await;
        return false;
    };
    let (least, most) = clock.high;
    let passes = clock.spread <= 2 && least >= 29 && most <= 35;
    let (spread, from, to) = (ns(clock.spread), ns(least), ns(most));
    let found = text!(
        "its rises are within {spread} ns of 2.625 MHz; it is high for {from} to {to} ns of 380"
    );
    report.check("fM", passes, &found, LOOK_AT).await;
    passes
}

/// t1 to t4 of the sensor's data sheet.
async fn check_pulses(report: &mut Report, expected: u32, has_master_clock: bool) {
    let [pulses, incomplete, doubled] =
        [&SEEN.pulses, &SEEN.incomplete, &SEEN.doubled].map(|it| it.load(Ordering::Relaxed));
    // The first one may have begun too early, and the last one may be under way.
    let all = pulses + 2 >= expected && pulses <= expected + 1 && incomplete == 0 && doubled == 0;
    let found = text!(
        "{pulses} of {expected} came over the wires, {incomplete} with an edge missing, \
         {doubled} with an edge twice"
    );
    let look_at = "look at the wires PF12 (D8) to PC6 (D16), ICG, and PF13 (D7) to PC8 (D43), SH";
    report.check("pulses", all, &found, look_at).await;
    if !all {
        for name in ["t1", "t2", "t3", "t4"] {
            report.skip(name, "pulses").await;
        }
        return;
    }
    for (name, seen, limits, what, of, look_at) in [
        (
            "t1",
            &SEEN.t1,
            1000..=u32::MAX,
            "ICG rises",
            " after SH fell, of at least 1000",
            "ICG rises too early: look at `ICG_LOW` and at interrupts",
        ),
        (
            "t2",
            &SEEN.t2,
            100..=1000,
            "SH rises",
            " after ICG fell, of 100 to 1000",
            "look at `ICG_TO_SH`, and whether something interrupts the pulses",
        ),
        (
            "t3",
            &SEEN.t3,
            1000..=u32::MAX,
            "SH is high for",
            ", of at least 1000",
            "look at `SH_HIGH`",
        ),
    ] {
        let (least, most) = seen.get();
        let (least, most) = (ns(least), ns(most));
        let passes = least >= *limits.start() && most <= *limits.end();
        let found = text!("{what} {least} to {most} ns{of}");
        report.check(name, passes, &found, look_at).await;
    }
    if !has_master_clock {
        report.skip("t4", "fM").await;
        return;
    }
    let (least, most) = SEEN.t4.get();
    let half = CYCLES_A_MASTER_CLOCK / 2;
    let (from, to, end) = (ns(least), ns(most), ns(half));
    let found = text!("ICG rises {from} to {to} ns after fM rose, of 0 to {end} (fM is high)");
    let look_at = "the program sets ICG too late: look at `raise_icg_at` and at waits for flash";
    report.check("t4", most < half, &found, look_at).await;
}

/// SCLK's edges, and the time that they take.
async fn check_sclk(report: &mut Report, expected: u32) {
    const LOOK_AT: &str =
        "look at the wires PA5 (D13) to PA0 (D32), SCLK, and PD14 (D10) to PB5 (D22), CS";
    let rows = SEEN.rows.load(Ordering::Relaxed);
    if rows + 3 < expected || rows > expected + 1 {
        let found = text!("chip select rose {rows} times in {expected} rows");
        report.check("SCLK edges", false, &found, LOOK_AT).await;
        report.skip("SCLK time", "SCLK edges").await;
        return;
    }
    let (least, most) = SEEN.edges.get();
    let passes = least == EDGES && most == EDGES;
    let found = text!("{least} to {most} in a row, of {EDGES} = 16 x {WORDS}");
    report.check("SCLK edges", passes, &found, LOOK_AT).await;
    if !passes {
        report.skip("SCLK time", "SCLK edges").await;
        return;
    }
    let (least, most) = SEEN.duration.get();
    let expected = (EDGES - 1) * wires::TICKS_A_BIT;
    // Half a period of SCLK: a gap of one period is an error.
    let off = least.abs_diff(expected).max(most.abs_diff(expected));
    let [from, to, whole] = [least, most, expected].map(|ticks| ns(2 * ticks));
    let found =
        text!("{from} to {to} ns from a row's first edge to its last, of {whole} without gaps");
    let passes = off <= wires::TICKS_A_BIT / 2;
    let look_at = "SPI waited for DMA: look at the DMA's priorities";
    report.check("SCLK time", passes, &found, look_at).await;
}

/// The words of rows with MISO low, high and open.
async fn check_miso(report: &mut Report) {
    const LOOK_AT: &str = "look at the wire PB13 (D18) to PA6 (D12)";
    for (name, level, expected, look_at) in [
        ("MISO low", Some(false), 0x0000, LOOK_AT),
        ("MISO high", Some(true), 0xFFFF, LOOK_AT),
        (
            "MISO open",
            None,
            0xFFFF,
            "look at PA6's pull-up, and at that wire",
        ),
    ] {
        wires::drive_miso(level);
        let wrong = wrong_words(|_, word| word == expected).await;
        let found = text!("{wrong} words of {} are not {expected:#06x}", 2 * WORDS);
        report.check(name, wrong == 0, &found, look_at).await;
    }
    wires::drive_miso_by_master_clock();
    let is_rotated = |word: u16| (0..4).any(|bits| word == 0x3333_u16.rotate_left(bits));
    let wrong = wrong_words(|first, word| word == first && is_rotated(word)).await;
    let found = text!(
        "{wrong} words of {} differ from their row's first or 0x3333 rotated",
        2 * WORDS
    );
    let look_at = "a bit slips, or the last bit is read too late: shorter wires, R9 at the board";
    report.check("MISO fM", wrong == 0, &found, look_at).await;
    wires::drive_miso(None);
}

/// The words of two rows that are not right, beside their row's first word.
async fn wrong_words(is_right: impl Fn(u16, u16) -> bool) -> usize {
    free_rows().await;
    let mut wrong = 0;
    for number in 0..4 {
        let row = next_row().await;
        // The first two may have begun before.
        if number >= 2 {
            wrong += row.as_ref().map_or(WORDS, |words| {
                let is_wrong = |&&word: &&u16| !is_right(words[0], word);
                words.iter().filter(is_wrong).count()
            });
        }
        if let Some(words) = row {
            ROWS.free.send(words).await;
        }
    }
    wrong
}

/// The next row's words. `None`: none came within 100 ms.
async fn next_row() -> Option<crate::rows::Buffer> {
    COUNTERS.results.add();
    let row = embassy_time::with_timeout(Duration::from_millis(100), ROWS.full.receive()).await;
    row.ok().map(|row| row.words)
}

/// Takes rows for ever, with signs of life.
async fn take_rows() {
    loop {
        if let Some(words) = next_row().await {
            ROWS.free.send(words).await;
        }
    }
}

/// The sector that is erased, the last of the store's four, and how many words are programmed.
const SECTOR: u32 = 3 * CalibrationFlash::ERASE_SIZE as u32;
const SECTOR_END: u32 = SECTOR + CalibrationFlash::ERASE_SIZE as u32;
const PROGRAMMED: usize = CalibrationFlash::ERASE_SIZE / 4;

/// How long the flash takes, and what becomes of the rows meanwhile.
async fn check_flash(report: &mut Report, flash: &mut CalibrationFlash) {
    static CONTENTS: ConstStaticCell<[u8; CalibrationFlash::ERASE_SIZE]> =
        ConstStaticCell::new([0; CalibrationFlash::ERASE_SIZE]);
    let contents = CONTENTS.take();
    let was_read = flash.read(SECTOR, contents).await.is_ok();
    let is_blank = contents.iter().all(|&byte| byte == 0xFF);

    let (erased, time, rows) = beside_rows(flash.erase(SECTOR, SECTOR_END)).await;
    let is_erased = erased.is_ok() && was_read;
    let found = text!(
        "16 KB in {} ms, of at most 800{}; {} rows meanwhile, {} lost or late",
        time.as_millis(),
        if is_erased { "" } else { ", with an error" },
        rows.rows,
        rows.bad()
    );
    let passes = is_erased && time <= Duration::from_millis(800) && rows.are_whole(time);
    let look_at =
        "slow: the supply is below 2.7 V, or the flash is worn; lost: the program is not in bank 1";
    report.check("erase", passes, &found, look_at).await;

    let pattern = [0x5A, 0xC3, 0x00, 0xF0];
    let (written, time, rows) = beside_rows(async {
        for word in 0..PROGRAMMED as u32 {
            flash.write(SECTOR + 4 * word, &pattern).await?;
        }
        Ok::<_, embassy_stm32::flash::Error>(())
    })
    .await;
    let mut word = [0; 4];
    let mut is_written = written.is_ok();
    for number in 0..PROGRAMMED as u32 {
        is_written &= flash.read(SECTOR + 4 * number, &mut word).await.is_ok() && word == pattern;
    }
    // 100 us of the flash, and 10 us of the program.
    let each = time.as_micros() / PROGRAMMED as u64;
    let found = text!(
        "{PROGRAMMED} words in {each} us each, of at most 110{}; \
         {} rows meanwhile, {} lost or late",
        if is_written { "" } else { ", with an error" },
        rows.rows,
        rows.bad()
    );
    let passes = is_written && each <= 110 && rows.are_whole(time);
    report.check("program", passes, &found, "as `erase`").await;

    // As it was before.
    let (restored, ..) = beside_rows(async {
        flash.erase(SECTOR, SECTOR_END).await?;
        if !is_blank {
            flash.write(SECTOR, contents).await?;
        }
        Ok::<_, embassy_stm32::flash::Error>(())
    })
    .await;
    if restored.is_err() {
        let note = "note: sector 15 of the flash is not as it was";
        report.line(note).await;
    }
}

/// Runs something while rows are taken. Gives its result, its time, and what became of the rows.
async fn beside_rows<T>(work: impl Future<Output = T>) -> (T, Duration, Counts) {
    free_rows().await;
    let (before, start) = (Counts::now(), Instant::now());
    match select(work, take_rows()).await {
        Either::First(result) => (result, start.elapsed(), Counts::since(&before)),
        Either::Second(()) => unreachable!("rows are taken for ever"),
    }
}

/// What each estimator takes, beside the estimate.
async fn check_estimators(report: &mut Report, load: &mut Load) {
    for estimator in Estimator::ALL {
        // Characters that leave interrupt.
        report.flush().await;
        let mut cycles = u32::MAX;
        // The least has no interrupts in it.
        for _ in 0..8 {
            cycles = cycles.min(load.compute(estimator));
            COUNTERS.results.add();
            free_rows().await;
        }
        let name = text!("cycles {}", estimator.name());
        let Some(estimate) = estimators::estimate(estimator) else {
            let found = text!("{cycles}, and docs/cost/whole-rows.csv has no line for it");
            let look_at = "look at that file";
            report.check(&name, false, &found, look_at).await;
            continue;
        };
        let found = text!(
            "{cycles} for a row, of {} instructions; estimated {} to {}",
            estimate.instructions,
            estimate.least,
            estimate.most
        );
        let passes = cycles <= estimate.most && cycles >= estimate.instructions / 10 * 9;
        let look_at = "more: the flash's caches are off, or the estimate is wrong";
        report.check(&name, passes, &found, look_at).await;
    }
}

/// Gives no sign of life until the watchdog bites. Returns if it does not.
async fn wait_for_watchdog(report: &mut Report) {
    Word::Passed.set(report.passed);
    Word::Failed.set(report.failed);
    Word::Skipped.set(report.skipped);
    let start = Instant::now();
    Word::Waited.set(0);
    Word::Waits.set_written();
    while start.elapsed() < Duration::from_secs(5) {
        Word::Waited.set(start.elapsed().as_millis() as u32);
        free_rows().await;
        Timer::after(Duration::from_millis(1)).await;
    }
    Word::Waits.set(0);
    report_watchdog(report, None).await;
}

/// The firmware notices after 1.2 s that there is no sign of life, or up to 0.1 s earlier. Then the watchdog
/// takes 1 s by its own clock: 0.68 to 1.88 s.
const BITES: core::ops::RangeInclusive<u32> = 1700..=3200;

async fn report_watchdog(report: &mut Report, waited: Option<u32>) {
    let look_at = "look at the watchdog's clock (LSI) and at the freeze in debug";
    let (least, most) = (BITES.start(), BITES.end());
    let found = match waited {
        Some(ms) => text!("reset {ms} ms after the last sign of life, of {least} to {most}"),
        None => text!("no reset within 5 s, of {least} to {most} ms"),
    };
    let passes = waited.is_some_and(|ms| BITES.contains(&ms));
    report.check("watchdog", passes, &found, look_at).await;
}
