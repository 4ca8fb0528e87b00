//! All that exists only on the chip.

use core::sync::atomic::{AtomicU32, Ordering};

use slitrange::{Estimator, Fault, Measured, Measurement, Options};
use slowest_on_chip::mailbox::{QUESTION, QUESTIONS, Question, READY};
use slowest_on_chip::words::{Maker, Turn, WORDS, geometry};

// Linked for what they define: where the log goes, and what a panic does.
use {defmt_rtt as _, panic_probe as _};

// Under names that they keep in the ELF file, by which the PC finds them.

/// How many questions there are to answer, or [`READY`].
#[unsafe(no_mangle)]
static ASKED: AtomicU32 = AtomicU32::new(0);

#[unsafe(no_mangle)]
static ASKED_WORDS: [AtomicU32; QUESTIONS * QUESTION] =
    [const { AtomicU32::new(0) }; QUESTIONS * QUESTION];

/// Instructions for the row of each question.
#[unsafe(no_mangle)]
static COUNTED: [AtomicU32; QUESTIONS] = [const { AtomicU32::new(0) }; QUESTIONS];

#[cortex_m_rt::entry]
fn main() -> ! {
    // The clock stays as a reset leaves it: lab/src/slowest/chip.rs lets the emulator run at that speed.
    // SAFETY: called once, before anything else could use these registers.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    core.DCB.enable_trace();
    // SAFETY: the cycle counter starts.
    unsafe { core.DWT.ctrl.modify(|control| control | 1) };
    let mut maker = Maker::default();
    let (mut before, mut now) = ([0; WORDS], [0; WORDS]);
    loop {
        ASKED.store(READY, Ordering::Release);
        let asked = loop {
            match ASKED.load(Ordering::Acquire) {
                READY => {}
                asked => break asked as usize,
            }
        };
        let questions = ASKED_WORDS.as_chunks().0.iter().take(asked);
        for (words, counted) in questions.zip(&COUNTED) {
            let words: &[AtomicU32; QUESTION] = words;
            let words = core::array::from_fn(|i| words[i].load(Ordering::Relaxed));
            let question = Question::from_words(&words);
            maker.write(&question.description, Turn::Now, &mut now);
            let before = question.follows.then(|| {
                maker.write(&question.description, Turn::Before, &mut before);
                &before
            });
            counted.store(count(question.estimator, before, &now), Ordering::Relaxed);
        }
    }
}

/// Counts the instructions for a row, after the row before if there is one.
#[inline(never)]
fn count(estimator: Estimator, before: Option<&[u16; WORDS]>, now: &[u16; WORDS]) -> u32 {
    let options = Options {
        estimator,
        ..Options::default()
    };
    let mut measurement = Measurement::new(geometry(), options);
    // The measurement may turn the words over.
    let mut words = *before.unwrap_or(now);
    if before.is_some() {
        let _ = measurement.row(&mut words);
        words = *now;
    }
    let start = cycle_count();
    let _ = slowest_row(&mut measurement, &mut words);
    cycle_count().wrapping_sub(start)
}

/// The chip's cycle counter, DWT_CYCCNT. A chip of ARMv6-M has none, but the emulated one does.
fn cycle_count() -> u32 {
    const CYCCNT: *const u32 = 0xE000_1004 as *const u32;
    // SAFETY: reading the register changes nothing.
    unsafe { CYCCNT.read_volatile() }
}

/// What is counted.
#[inline(never)]
#[unsafe(no_mangle)]
fn slowest_row(
    measurement: &mut Measurement,
    words: &mut [u16; WORDS],
) -> Option<Result<Measured, Fault>> {
    measurement.row(words)
}
