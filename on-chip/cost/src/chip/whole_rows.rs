//! Whole rows, from their words to their centre with its check, as the firmware measures them; and what comes
//! once a frame.

use core::array::from_fn;
use core::sync::atomic::{AtomicU32, Ordering};

use cost_on_chip::rows::{self, PIXELS, ROWS, Turn, WIDTHS, WORDS};
use cost_on_chip::whole_rows::{COMB, FRAME, Order, WIDTH};
use slitrange::frame::comb::Slits;
use slitrange::{
    Calibration, CalibrationErrors, Estimator, Fault, Measured, Measurement, Options, Reading,
    Surface,
};

use super::board::let_the_log_out;
use super::counter::{self, Cost};

/// Counts the first two rows of a frame at each width, [`ROWS`] times, and the last of a frame at [`WIDTH`]
/// with its distance; by each estimator.
pub fn measure() {
    for width in WIDTHS {
        for number in 0..ROWS {
            for estimator in Estimator::ALL {
                measure_two(width, number, estimator);
            }
        }
    }
    for estimator in Estimator::ALL {
        measure_the_last(estimator);
    }
    measure_comb();
}

/// Counts the first, the second and the last row of a comb's frame, by the default estimator.
#[inline(never)]
fn measure_comb() {
    let mut words = [0; WORDS];
    let mut pixels = [0; PIXELS];
    let options = Options {
        rows: FRAME,
        slits: Slits::Comb,
        ..Options::default()
    };
    let mut measurement = Measurement::new(rows::geometry(), options);
    for place in 1..=FRAME {
        rows::comb_light(Turn::OfFrame(place), &mut pixels);
        rows::words(&pixels, &mut words);
        if place > 2 && place < FRAME {
            defmt::assert!(measurement.row(&mut words).is_none());
            continue;
        }
        let (cost, measured) = count(&mut measurement, &words);
        if let Some(measured) = measured {
            let comb = defmt::unwrap!(measured.ok().and_then(|measured| measured.comb));
            defmt::assert!(comb.used == 16);
        }
        print_row(COMB, WIDTH, 0, place, cost);
        let_the_log_out();
    }
}

/// Counts the first two rows of a frame. One pipeline at a time: five do not fit the stack.
#[inline(never)]
fn measure_two(width: f32, number: usize, estimator: Estimator) {
    let mut words = [0; WORDS];
    let mut measurement = measurement(estimator);
    for (place, turn) in [(1, Turn::Before), (2, Turn::Now)] {
        write_words(width, number, turn, &mut words);
        let (cost, measured) = count(&mut measurement, &words);
        defmt::assert!(measured.is_none());
        print_row(estimator.name(), width, number, place, cost);
        let_the_log_out();
    }
}

/// Counts the row that completes a frame, and the distance.
#[inline(never)]
fn measure_the_last(estimator: Estimator) {
    let mut words = [0; WORDS];
    let mut measurement = measurement(estimator);
    let calibration = Calibration::nominal();
    for place in 1..=FRAME {
        write_words(WIDTH, 0, Turn::OfFrame(place), &mut words);
        if place < FRAME {
            defmt::assert!(measurement.row(&mut words.clone()).is_none());
            continue;
        }
        let (cost, measured) = count(&mut measurement, &words);
        print_row(estimator.name(), WIDTH, 0, FRAME, cost);
        let measured = defmt::unwrap!(measured.and_then(Result::ok));
        let given = (measured, calibration.as_ref());
        let mut reading = None;
        let cost = counter::count(step_reading, &given, &mut reading);
        defmt::assert!(matches!(reading, Some(Ok(_))));
        defmt::println!("reading {} cycles {}", estimator.name(), cost.cycles);
        let_the_log_out();
    }
}

/// As the firmware starts with.
fn measurement(estimator: Estimator) -> Measurement {
    let options = Options {
        estimator,
        rows: FRAME,
        ..Options::default()
    };
    Measurement::new(rows::geometry(), options)
}

fn write_words(width: f32, number: usize, turn: Turn, words: &mut [u16; WORDS]) {
    let mut pixels = [0; PIXELS];
    rows::light(width, number, turn, &mut pixels);
    rows::words(&pixels, words);
}

/// `place`: the row's in its frame, from 1.
fn print_row(name: &str, width: f32, number: usize, place: u16, cost: Cost) {
    defmt::println!(
        "whole-row {} width {} number {} place {} cycles {}",
        name,
        width,
        number,
        place,
        cost.cycles
    );
}

/// The pipeline, the words of its next row, and what came of it.
struct Pipeline<'a> {
    measurement: &'a mut Measurement,
    words: [u16; WORDS],
    measured: Option<Result<Measured, Fault>>,
}

fn count(
    measurement: &mut Measurement,
    words: &[u16; WORDS],
) -> (Cost, Option<Result<Measured, Fault>>) {
    let mut pipeline = Pipeline {
        measurement,
        words: *words,
        measured: None,
    };
    let cost = counter::count(step_measurement_row, &(), &mut pipeline);
    (cost, pipeline.measured)
}

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn step_measurement_row(_: &(), pipeline: &mut Pipeline<'_>) {
    // As the firmware, which passes on the result of a complete frame.
    let measured = pipeline.measurement.row(&mut pipeline.words);
    if measured.is_some() {
        pipeline.measured = measured;
    }
}

#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn step_reading(
    (measured, calibration): &(Measured, Option<&Calibration>),
    reading: &mut Option<Result<Reading, Fault>>,
) {
    *reading = Some(measured.reading(*calibration, &CalibrationErrors::Nominal, Surface::Auto));
}

// Under names that they keep in the ELF file, by which `cargo cost` finds them.

/// What to do with the row that was put into [`ROW`]: an [`Order`] as a word. 0 once it is done.
#[unsafe(no_mangle)]
static ASKED: AtomicU32 = AtomicU32::new(0);

/// Two words of a read-out in each.
#[unsafe(no_mangle)]
static ROW: [AtomicU32; WORDS / 2] = [const { AtomicU32::new(0) }; WORDS / 2];

/// Measures the rows that the emulator's user puts into memory.
pub fn serve() -> ! {
    let mut under_way = measurement(Estimator::default());
    loop {
        let Some(order) = Order::from_word(ASKED.load(Ordering::Acquire)) else {
            continue;
        };
        if order.is_first {
            under_way = measurement(order.estimator);
        }
        let words: [u16; WORDS] = from_fn(|i| {
            let two = ROW.get(i / 2).map_or(0, |two| two.load(Ordering::Relaxed));
            (two >> (16 * (i % 2))) as u16
        });
        count(&mut under_way, &words);
        ASKED.store(0, Ordering::Release);
    }
}
