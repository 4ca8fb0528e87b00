//! Driver of the sensor Hamamatsu S11639-01 behind a converter ADC122S101.
//!
//! All pixels gather light while ST is high, and for 48 periods of CLK after ST fell. The sensor then puts
//! out 2048 pixels, one in each period of CLK. CLK never stops. The next exposure may begin while pixels come
//! out.
//!
//! The converter samples its input in the fourth period of SCLK after chip select falls, and every 16 periods
//! from there on while chip select stays low. With CLK = SCLK / 16, both from one PLL, a word is a pixel.
//!
//! # Design
//!
//! ```text
//! CLK     __|‾‾|__|‾‾|__|‾‾|__|‾‾|__|‾‾|__   __|‾‾|__|‾‾|__|‾‾|__   ___________
//! ST      ‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾|______   _____________________   ____|‾‾‾‾‾‾
//! CS      ‾‾‾‾|___________________________   _____________________   ___________
//! word        |  0  |  1  |  2  |  3  |  4    | 92  | 93  | 94  |    ...
//! output                                        |  0  |  1  |  2  |    ...
//! sampled       ^     ^     ^     ^             ^     ^     ^
//! ```
//!
//! As with the TCD1304 the converter runs first, because the program cannot say when the first word will
//! start, but can see it arrive. ST then falls while CLK is low, before the rise of CLK that makes word 92
//! sample the first pixel ([`S11639_LEAD_IN`](slitrange::row::sensor_heads::S11639_LEAD_IN)). Unlike ICG, ST
//! cannot move pixels against words by less than a period. So the transfer starts at a fixed time after CLK
//! rose. A slower core takes longer from there to the first word. So the driver first reads a few words while
//! ST is high, when no pixels come, and chooses the start of the next transfer by them. It does so again if
//! the pixels of a row are sampled far from the middle of their time, and rejects a row that is sampled too
//! early or too late.
//!
//! # Note
//!
//! * ST has to stay low for 100 periods of CLK, 152 us. The program gives this time to others: an alarm ends
//!   it, and the laser starts then.
//! * The data sheet counts pulses of the sensor's output Trig, which nothing reads here. That Trig rises with
//!   CLK, and that the first pixel belongs to the 89th of its pulses after the fall of ST, is an assumption:
//!   look at both with an oscilloscope. Another count changes `S11639_LEAD_IN`, another phase
//!   [`CLOCK_AFTER_WORD_0`].

use core::future::{Future, poll_fn};
use core::ops::RangeInclusive;
use core::pin::{Pin, pin};
use core::task::{Context, Poll};

use embassy_stm32::Peri;
use embassy_stm32::gpio::{AnyPin, Level, Output, Speed};
use embassy_time::{Duration, Instant, Timer, with_timeout};
use slitrange::base::exposure::Exposure;
use slitrange::row::Geometry;
use slitrange::row::sensor_heads;

use super::acquisition::set_alarm;
use super::board::{self, CYCLES_A_MASTER_CLOCK, Converter, MasterClock};
use super::laser::Laser;
use super::sensor_head::{
    READ_OUT_TIMEOUT, ReadOutError, SCLK_HZ, end_read_out, find_end_of_word_0, poll_until,
    wait_until,
};
use super::shared::{COUNTERS, WORDS};

/// The sensor head's name.
pub const NAME: &str = "S11639-01";

/// The geometry of a row.
pub const fn geometry() -> Geometry {
    sensor_heads::s11639()
}

/// CLK, from TIM1: 656.25 kHz. The sensor takes 0.2 to 10 MHz.
pub const MASTER_CLOCK_HZ: u32 = SCLK_HZ / 16;

/// Time from one row to the next: a read-out (3.28 ms), and some slack. 300 rows a second.
pub const ROW_PERIOD: Duration = Duration::from_micros(3330);

/// The longest time of the laser in a row.
pub const LONGEST_EXPOSURE: Exposure = Exposure::from_us(3000).unwrap();

/// ST stays low for at least 100 periods of CLK, 152.4 us. The alarm's clock counts microseconds.
const ST_LOW: Duration = Duration::from_micros(154);

/// From a rise of CLK to the start of the first transfer, which reads no row.
const TRANSFER_START: u32 = 2 * CYCLES_A_MASTER_CLOCK;

/// The words of that transfer. The program measures when one of them ends; a slow core misses the first ones.
const WORDS_OF_TRIAL: usize = 16;

/// From the end of word 0 to the rise of CLK that follows the fall of ST, if pixels are sampled at once when
/// they come out: `WORDS` and the lead-in fix it.
///
/// Pixel 0 is at the output from half a period before the 89th rise on. Word 92 starts 91 periods after the
/// end of word 0, and the converter samples when 3.5 SCLK of a word have passed.
const CLOCK_AFTER_WORD_0: u32 =
    3 * CYCLES_A_MASTER_CLOCK + CYCLES_A_MASTER_CLOCK / 2 + 7 * CYCLES_A_MASTER_CLOCK / 32;

/// The parts of a pixel's time at which it may be sampled, in percent.
const SAMPLED: RangeInclusive<u32> = 30..=90;

/// Within these parts, in percent, the next transfer starts at the same time as this one. DMA's
/// 20 cycles and half a turn of the program's loop, 5 instructions, make a row seem to be sampled up to 10 %
/// too early or too late, and 12 % at 84 million instructions a second. The choice of a start has this error
/// too, so the limits lie nearly twice as far from the middle.
const NEAR_MIDDLE: RangeInclusive<u32> = 38..=82;

/// The part of its time at which a pixel is to be sampled, in percent.
const MIDDLE: u32 = 60;

/// The last rise of CLK at which the pixels may begin to be counted, if word 0 ended then: word 92 still
/// samples pixel 0.
fn rise_after_word_0(word_0_ended: u32) -> u32 {
    let clock_rose = board::master_clock_rose();
    let periods_back = CLOCK_AFTER_WORD_0.wrapping_sub(clock_rose.wrapping_sub(word_0_ended));
    // `clock_rose` is less than `CLOCK_AFTER_WORD_0` after the end of word 0, or the row is late.
    let periods = (periods_back as i32).div_euclid(CYCLES_A_MASTER_CLOCK as i32);
    clock_rose.wrapping_add((periods * CYCLES_A_MASTER_CLOCK as i32) as u32)
}

/// The part of its time at which a pixel is sampled, in percent, if CLK rises so long after word 0 ended.
const fn part_sampled(after: u32) -> u32 {
    CLOCK_AFTER_WORD_0.saturating_sub(after) * 100 / CYCLES_A_MASTER_CLOCK
}

/// When a transfer is to start, in cycles after a rise of CLK. The transfer before started at `start`, and
/// its pixels were sampled when so many percent of their time had passed.
const fn next_start(start: u32, sampled: u32) -> u32 {
    const LEAST: u32 = 2 * CYCLES_A_MASTER_CLOCK;
    // Pixels are sampled as much later as the transfer starts later, by whole pixels less.
    let later = (100 + MIDDLE - sampled) * CYCLES_A_MASTER_CLOCK / 100;
    LEAST + (start - LEAST + later) % CYCLES_A_MASTER_CLOCK
}

const _: () = {
    // 60 % stays, and 10 % is half a pixel too early.
    let half = CYCLES_A_MASTER_CLOCK / 2;
    assert!(next_start(2 * CYCLES_A_MASTER_CLOCK, 60) == 2 * CYCLES_A_MASTER_CLOCK);
    assert!(next_start(2 * CYCLES_A_MASTER_CLOCK, 10) == 2 * CYCLES_A_MASTER_CLOCK + half);
    assert!(next_start(3 * CYCLES_A_MASTER_CLOCK - half, 10) == 2 * CYCLES_A_MASTER_CLOCK);
};

/// From the fall of ST, in word 3, to a look at the words that have come: all pixels have, and the last words
/// have not. An alarm may be late by most of these, 13 us.
const LOOK: Duration = Duration::from_micros(3260);

/// The laser's longest pulse ends before the next row begins.
const _: () = assert!(
    LONGEST_EXPOSURE.us() as u64 + ST_LOW.as_micros() + 100 <= ROW_PERIOD.as_micros(),
    "the laser would shine into the next row"
);

/// The wires to the sensor head beside clock and SPI.
pub struct Pins {
    /// Start pulse. All pixels gather light while it is high.
    st: Output<'static>,
    /// The converter's chip select, idle high.
    chip_select: Output<'static>,
    /// The laser's switch.
    laser: Laser,
}

/// The sensor head.
pub struct SensorHead {
    converter: Converter,
    pins: Pins,
    /// For how long the laser is on in the row that is being exposed; `None` if it is off.
    exposing: Option<Exposure>,
    /// From a rise of CLK to the start of the next transfer, in cycles; `None` before the first transfer.
    transfer_start: Option<u32>,
    /// The clock runs as long as this is kept.
    _master_clock: MasterClock,
}

impl SensorHead {
    /// A sensor head whose clock runs.
    pub fn new(converter: Converter, pins: Pins, master_clock: MasterClock) -> Self {
        Self {
            converter,
            pins,
            exposing: None,
            transfer_start: None,
            _master_clock: master_clock,
        }
    }

    /// For how long the laser is on in the row that is being exposed; `None` if it is off.
    pub const fn exposing(&self) -> Option<Exposure> {
        self.exposing
    }

    /// Ends an exposure without reading its row. The next exposure begins as if the row had been read: the
    /// laser is on in it for `laser`, or off.
    pub async fn pulse(&mut self, laser: Option<Exposure>) {
        self.exposing = laser;
        self.pins.laser.set_exposure(laser);
        if self.transfer_start.is_none() {
            self.transfer_start = self.find_transfer_start().await;
        }
        // The pulse ends a row that nobody reads, so it matters little if CLK rises while ST falls.
        let _ = cortex_m::interrupt::free(|_| {
            let rise = board::master_clock_rose().wrapping_add(2 * CYCLES_A_MASTER_CLOCK);
            self.pins.lower_st(rise)
        });
        Timer::after(ST_LOW).await;
        self.pins.raise_st();
    }

    /// Reads a few words, of which none is a pixel, and gives the start of a transfer of which the pixels are
    /// sampled in the middle of their time. `None` if no word came.
    async fn find_transfer_start(&mut self) -> Option<u32> {
        let Self {
            converter, pins, ..
        } = self;
        let mut words = [0_u16; WORDS_OF_TRIAL];
        let mut found = None;
        {
            let mut transfer = pin!(converter.read(&mut words[..]));
            poll_fn(|context| {
                Poll::Ready(cortex_m::interrupt::free(|_| {
                    let _ = pins.start(TRANSFER_START, transfer.as_mut(), context);
                    let word_0_ended = find_end_of_word_0(WORDS_OF_TRIAL, CYCLES_A_MASTER_CLOCK)?;
                    let after = rise_after_word_0(word_0_ended).wrapping_sub(word_0_ended);
                    found = Some(next_start(TRANSFER_START, part_sampled(after)));
                    found
                }))
            })
            .await;
            let _ = with_timeout(READ_OUT_TIMEOUT, transfer).await;
        }
        self.pins.chip_select.set_high();
        found
    }

    /// Ends an exposure and reads its row. Sets the alarm at `next`, when the next exposure should end: the
    /// laser is on in that one for `laser`, or off. Returns for how long the laser was on in the row that was
    /// read; `None` if it was off.
    pub async fn read_out(
        &mut self,
        row: &mut [u16; WORDS],
        next: Instant,
        laser: Option<Exposure>,
    ) -> Result<Option<Exposure>, ReadOutError> {
        let Self {
            converter,
            pins,
            exposing,
            transfer_start,
            ..
        } = self;
        let exposed = core::mem::replace(exposing, laser);
        let mut word_0 = Err(ReadOutError::Late);
        let (mut rise, mut look) = (next, next);
        pins.laser.set_exposure(laser);
        let result = {
            let mut transfer = pin!(converter.read(&mut row[..]));
            let started = poll_fn(|context| {
                Poll::Ready(cortex_m::interrupt::free(|_| {
                    let start = transfer_start.unwrap_or(TRANSFER_START);
                    let started = pins.start(start, transfer.as_mut(), context);
                    word_0 = pins.lower_st_after_word_0(start, transfer_start);
                    rise = Instant::now() + ST_LOW;
                    look = Instant::now() + LOOK;
                    started
                }))
            });
            let mut result = started.await;
            set_alarm(rise).await;
            if result.is_pending() {
                result = poll_until(rise, transfer.as_mut()).await;
            }
            // A transfer may fail at once.
            Timer::at(rise).await;
            pins.raise_st();
            end_read_out(
                transfer,
                result,
                word_0,
                CYCLES_A_MASTER_CLOCK,
                [look, next],
            )
            .await
        };
        self.pins.chip_select.set_high();
        result.map(|()| exposed)
    }
}

impl Pins {
    /// The wires at their rest: ST high, the converter not selected. The pin of the TCD1304's SH is not used.
    pub fn new(
        st: Peri<'static, AnyPin>,
        _: Peri<'static, AnyPin>,
        chip_select: Peri<'static, AnyPin>,
        laser: Laser,
    ) -> Self {
        Self {
            st: Output::new(st, Level::High, Speed::VeryHigh),
            chip_select: Output::new(chip_select, Level::High, Speed::VeryHigh),
            laser,
        }
    }

    /// Starts a transfer, so many cycles after a rise of CLK. The same code for each transfer, because its
    /// instructions are a part of the time to the first word.
    #[inline(never)]
    fn start<T>(
        &mut self,
        start: u32,
        transfer: Pin<&mut impl Future<Output = T>>,
        context: &mut Context<'_>,
    ) -> Poll<T> {
        wait_until(board::master_clock_rose(), start);
        // SCLK floats until the transfer enables SPI, so the converter listens only now.
        self.chip_select.set_low();
        transfer.poll(context)
    }

    /// Lowers ST half a period before this rise of CLK.
    ///
    /// # Errors
    /// [`ReadOutError::Late`] if ST fell too near to that rise.
    fn lower_st(&mut self, rise: u32) -> Result<(), ReadOutError> {
        const HALF: u32 = CYCLES_A_MASTER_CLOCK / 2;
        let fall = rise.wrapping_sub(HALF);
        wait_until(fall, 0);
        self.st.set_low();
        if board::cycles().wrapping_sub(fall) >= HALF {
            return Err(ReadOutError::Late);
        }
        Ok(())
    }

    /// Waits for the end of a word, and lowers ST before the rise of CLK that suits the words. If no word
    /// comes, ST falls all the same, and the transfer runs into its timeout. Changes the start of the next
    /// transfer if the pixels are sampled far from their middle; this one started at `start`. Returns when
    /// word 0 ended, by the cycle counter.
    ///
    /// # Errors
    /// [`ReadOutError::Late`] if no word came, if ST fell too late, or if the pixels will not be sampled in
    /// the middle of their time.
    fn lower_st_after_word_0(
        &mut self,
        start: u32,
        transfer_start: &mut Option<u32>,
    ) -> Result<u32, ReadOutError> {
        let word_0 = find_end_of_word_0(WORDS, CYCLES_A_MASTER_CLOCK);
        let word_0_ended = word_0.unwrap_or_else(board::cycles);
        let rise = rise_after_word_0(word_0_ended);
        self.lower_st(rise)?;
        let word_0_ended = word_0.ok_or(ReadOutError::Late)?;
        let sampled = part_sampled(rise.wrapping_sub(word_0_ended));
        if !NEAR_MIDDLE.contains(&sampled) {
            *transfer_start = Some(next_start(start, sampled));
        }
        if !SAMPLED.contains(&sampled) {
            return Err(ReadOutError::Late);
        }
        COUNTERS.sampled_earliest.set_if_smaller(sampled);
        COUNTERS.sampled_latest.set_if_larger(sampled);
        Ok(word_0_ended)
    }

    /// Raises ST, and starts the laser.
    fn raise_st(&mut self) {
        cortex_m::interrupt::free(|_| {
            self.st.set_high();
            self.laser.start();
        });
    }
}
