//! The estimators on seeded rows. They keep the processor busy, and their cycles are counted.

use core::sync::atomic::{Ordering, compiler_fence};

use cost_on_chip::rows::{self, PIXELS, Turn, WORDS};
use cost_on_chip::whole_rows::{FRAME, WIDTH};
use slitrange::{Estimator, Measurement, Options};
use static_cell::ConstStaticCell;

use crate::board;

/// What `cargo cost` counts.
const ESTIMATES: &str = include_str!("../../../docs/cost/whole-rows.csv");

/// Tenths of a cycle that an instruction of these rows takes on silicon, the fewest and the most:
/// docs/accuracy.md, "How it is measured".
const CYCLES: [u32; 2] = [12, 27];

pub struct Load {
    pixels: &'static mut [u16; PIXELS],
    before: &'static mut [u16; WORDS],
    now: &'static mut [u16; WORDS],
    words: &'static mut Aligned,
}

/// Words at an address that is a multiple of 4. At others, a row takes 10,000 instructions more.
#[repr(align(4))]
struct Aligned([u16; WORDS]);

impl Load {
    /// Makes two rows. Call it once.
    pub fn new() -> Self {
        static PIXEL_MEMORY: ConstStaticCell<[u16; PIXELS]> = ConstStaticCell::new([0; PIXELS]);
        static BEFORE: ConstStaticCell<[u16; WORDS]> = ConstStaticCell::new([0; WORDS]);
        static NOW: ConstStaticCell<[u16; WORDS]> = ConstStaticCell::new([0; WORDS]);
        static MEMORY: ConstStaticCell<Aligned> = ConstStaticCell::new(Aligned([0; WORDS]));
        let load = Self {
            pixels: PIXEL_MEMORY.take(),
            before: BEFORE.take(),
            now: NOW.take(),
            words: MEMORY.take(),
        };
        for (turn, words) in [
            (Turn::Before, &mut *load.before),
            (Turn::Now, &mut *load.now),
        ] {
            rows::light(WIDTH, 0, turn, load.pixels);
            rows::words(load.pixels, words);
        }
        load
    }

    /// Computes two rows, the first of a frame and one that follows. Gives the core cycles of the second,
    /// interrupts included.
    #[inline(never)]
    pub fn compute(&mut self, estimator: Estimator) -> u32 {
        let options = Options {
            estimator,
            rows: FRAME,
            ..Options::default()
        };
        let mut measurement = Measurement::new(rows::geometry(), options);
        let words = &mut self.words.0;
        words.copy_from_slice(self.before);
        let _ = measurement.row(words);
        words.copy_from_slice(self.now);
        compiler_fence(Ordering::SeqCst);
        let start = board::cycles();
        compute_row(&mut measurement, words);
        board::cycles().wrapping_sub(start)
    }
}

/// A call, so that the compiler moves nothing out or in.
#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn compute_row(measurement: &mut Measurement, words: &mut [u16; WORDS]) {
    if let Some(measured) = measurement.row(words) {
        core::hint::black_box(measured).ok();
    }
    compiler_fence(Ordering::SeqCst);
}

pub struct Estimate {
    /// Instructions, counted on the virtual board.
    pub instructions: u32,
    /// The least cycles that silicon may take.
    pub least: u32,
    /// The most.
    pub most: u32,
}

/// The estimate of a row that follows another one. `None`: the table has another form.
pub fn estimate(estimator: Estimator) -> Option<Estimate> {
    let mut lines = ESTIMATES.lines();
    let header = lines.next()?;
    let column = |name| header.split(',').position(|it| it == name);
    let line = lines.find(|line| {
        let mut fields = line.split(',');
        fields.next() == Some("following")
            && fields.next() == Some(estimator.name())
            && fields.next().and_then(|width| width.parse().ok()) == Some(WIDTH)
    })?;
    let instructions: u32 = line.split(',').nth(column("total")?)?.parse().ok()?;
    Some(Estimate {
        instructions,
        least: instructions * CYCLES[0] / 10,
        most: instructions * CYCLES[1] / 10,
    })
}
