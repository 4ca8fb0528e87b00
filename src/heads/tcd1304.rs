//! Driver of the sensor Toshiba TCD1304DG behind a converter ADC122S101.
//!
//! The sensor gathers light all the time. A pulse on SH moves this light into the shift register. So the
//! exposure to the light of the room is the time from one pulse to the next. The laser is on for a part of
//! that time. The register takes the light only while ICG is low: the driver pulls ICG low, pulses SH, and
//! pulls ICG up. When ICG rises, the register puts out a pixel every four periods of fM, 3694 of them. fM
//! never stops.
//!
//! The converter samples its input in the fourth period of SCLK after chip select falls, and every 16 periods
//! from there on while chip select stays low. With fM = SCLK / 4, both from one PLL, a word is a pixel, and a
//! row is one DMA transfer of 3694 words.
//!
//! # Design
//!
//! ```text
//! fM      ‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_‾_
//! ICG     ‾‾‾‾|______________________________________|‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾
//! SH      ______|‾‾‾‾‾‾‾‾‾‾|____________________________________________________
//! CS      ‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾‾|__________________________________________________
//! word                    |  0    |  1    |  2    |  3    |  4    |  5    |  ...
//! output                                             |  D0   |  D1   |  D2   |
//! sampled                   ^       ^       ^       ^       ^       ^       ^
//! ```
//!
//! The program cannot say to a fraction of a pixel when the first word will start, but it can see words
//! arrive. So the converter runs first, and ICG rises on the edge of fM that is nearest to
//! [`ICG_AFTER_WORD_0`] after the end of word 0. The converter then samples each pixel in its second half,
//! when the output has settled, and word 4 is D0 ([`TCD1304DG_LEAD_IN`]). A slow core may miss the first
//! words: it waits for the end of the next one, and subtracts those before it. The two fM edges at which ICG
//! falls and the transfer starts are fixed too, so that pixel and conversion keep their phase from row to
//! row. ICG moves a little after fM's edge, because it has to rise while fM is high. The transfer starts
//! after SH fell and the laser began, so that little is left to do before ICG rises.
//!
//! The pulses are given in a critical section: an interrupt would stretch them.
//!
//! If DMA fed SPI late, SCLK would pause and all pixels after it would be shifted. So the program looks at
//! the time when the words of all light pixels have come ([`end_read_out`]).
//!
//! # Note
//!
//! * Pulses are timed by the cycle counter and not by delay loops, so that flash wait states do not stretch
//!   them.
//! * embassy's `read` starts DMA and SPI within its first poll, which is why it is polled within the critical
//!   section. It enables SPI1 there, just after chip select fell. Until then nothing drives SCLK and its
//!   pull-up (which embassy sets in mode 3) keeps it high: enabling makes no edge that the converter could
//!   count.
//! * SPI mode 3, as in the converter's timing diagram: SCLK idles high, DOUT changes as it falls, is read as
//!   it rises. The converter's DIN is at ground, which selects channel 1. PA7, SPI1's output, is not used:
//!   the board's Ethernet drives it.
//! * On a real board, look with an oscilloscope at the phase at which a pixel is sampled. ICG_AFTER_WORD_0
//!   sets it.

use core::future::{Future as _, poll_fn};
use core::pin::pin;
use core::task::Poll;

use embassy_time::{Duration, Instant};
use slitrange::base::exposure::Exposure;
use slitrange::row::Geometry;
use slitrange::row::sensor_heads::{self, TCD1304DG_LEAD_IN};

use super::read_out::{ReadOutError, SCLK_HZ, end_read_out, find_end_of_word_0};
use super::{CYCLES_A_MASTER_CLOCK, WORDS};
use crate::board::{self, Converter, MasterClock, Pins, cycles_in_ns, wait_until};
use crate::counters::COUNTERS;

/// The sensor head's name.
pub const NAME: &str = "TCD1304DG";

/// The geometry of a row.
pub const fn geometry() -> Geometry {
    sensor_heads::tcd1304dg()
}

/// fM, from TIM1 (168 MHz) / 64: a pixel takes four periods.
pub const MASTER_CLOCK_HZ: u32 = SCLK_HZ / 4;

/// Time from one row to the next, and so the exposure to all light but the laser's: a read-out (5.63 ms), the
/// pulses and some slack. 175 rows a second.
pub const ROW_PERIOD: Duration = Duration::from_micros(5700);

/// The longest time of the laser in a row.
pub const LONGEST_EXPOSURE: Exposure = Exposure::LONGEST;

/// The longest pulse ends before the next row begins, with 100 us of room for a tick that is late.
const _: () = assert!(LONGEST_EXPOSURE.us() as u64 + 100 <= ROW_PERIOD.as_micros());

/// fM is high for half of its period.
const MASTER_CLOCK_HIGH: u32 = CYCLES_A_MASTER_CLOCK / 2;

/// From the fall of ICG to the rise of SH: 100 to 1000 ns (data sheet, t2).
const ICG_TO_SH: u32 = cycles_in_ns(500);

/// SH stays high for at least 1000 ns (data sheet, t3).
const SH_HIGH: u32 = cycles_in_ns(1500);

/// From the fall of ICG to the start of the transfer: fixed to fM, after SH fell and the laser began. With
/// nine sixteenths of a period, the wanted rise of ICG is near a rise of fM. So each row takes the same rise,
/// whatever DMA's latency is (virtual board: pixels are sampled at 65 to 68 % of their time).
const TRANSFER_START: u32 = 8 * CYCLES_A_MASTER_CLOCK + 9 * CYCLES_A_MASTER_CLOCK / 16;

/// From the fall of SH to the rise of ICG, at least (data sheet, t1).
const SH_TO_ICG: u32 = cycles_in_ns(1000);

/// From the fall of ICG to its rise if no row is read.
const ICG_LOW: u32 = 10 * CYCLES_A_MASTER_CLOCK;

/// A pixel stays at the output for four periods of fM.
const CYCLES_A_PIXEL: u32 = 4 * CYCLES_A_MASTER_CLOCK;

/// The converter is to sample a pixel when 70 % of its time have passed: 1067 of 1524 ns.
const SAMPLED: u32 = cycles_in_ns(1067);

/// From the end of word 0 to the rise of ICG, to the nearest rise of fM. Word 4 is D0. It starts three words
/// after the end of word 0, and the converter samples it when 3.5 SCLK of it have passed (333 ns).
const ICG_AFTER_WORD_0: u32 =
    (TCD1304DG_LEAD_IN as u32 - 1) * CYCLES_A_PIXEL + cycles_in_ns(333) - SAMPLED;

/// ICG rises in the last word before D0.
const _: () = assert!(TCD1304DG_LEAD_IN == 4);

/// From the rise of ICG, in word 3, to a look at the words that have come: all light pixels have, and the
/// last eight words, 12 us, have not. An alarm may be late by most of them.
const LOOK: Duration = Duration::from_micros(5611);

/// The pulses are within the limits of the data sheet.
const _: () = {
    assert!(ICG_TO_SH > cycles_in_ns(100) && ICG_TO_SH < cycles_in_ns(1000));
    assert!(SH_HIGH > cycles_in_ns(1000));
    assert!(ICG_LOW - ICG_TO_SH - SH_HIGH > SH_TO_ICG);
    assert!(ICG_TO_SH + SH_HIGH < TRANSFER_START);
};

/// From the fall of ICG to its rise.
#[derive(Default)]
struct IcgRise {
    /// The time that suits the words, in core cycles: a mean over some rows.
    wanted: u32,
    /// The choice by this mean: periods of fM.
    periods: u32,
}

impl IcgRise {
    /// When ICG is to rise, with fM, in a row whose words want it to rise after `wanted` cycles. Both in
    /// cycles after the fall of ICG.
    ///
    /// The program takes the same time to get here in every row, give or take some cycles. If this rounded up
    /// in one row and down in the next, pixels would be sampled a quarter of their time earlier or later. So
    /// the mean decides, and the last choice stays while it is nearly right. A row that is far from the mean
    /// decides for itself: the first row takes some instructions more.
    fn choose(&mut self, wanted: u32) -> u32 {
        const PERIOD: u32 = CYCLES_A_MASTER_CLOCK;
        let nearest = |wanted: u32| (wanted + PERIOD / 2) / PERIOD;
        let off = wanted as i32 - self.wanted as i32;
        if off.unsigned_abs() > PERIOD / 2 {
            self.wanted = wanted;
        } else {
            self.wanted = self.wanted.saturating_add_signed(off / 4);
        }
        if self.wanted.abs_diff(self.periods * PERIOD) > PERIOD * 5 / 8 {
            self.periods = nearest(self.wanted);
        }
        match wanted.abs_diff(self.periods * PERIOD) {
            ..=MOST_OFF => self.periods * PERIOD,
            _ => nearest(wanted) * PERIOD,
        }
    }
}

/// ICG rises at most so many cycles before or after the wanted time: 22 % of a pixel.
const MOST_OFF: u32 = CYCLES_A_MASTER_CLOCK * 7 / 8;

/// The sensor head.
pub struct Tcd1304 {
    converter: Converter,
    pins: Pins,
    /// For how long the laser is on in the row that is being exposed; `None` if it is off.
    exposing: Option<Exposure>,
    /// When ICG rises.
    icg_rise: IcgRise,
    /// The clock runs as long as this is kept.
    _master_clock: MasterClock,
}

impl Tcd1304 {
    /// A sensor head whose clock runs.
    pub fn new((converter, pins, master_clock): (Converter, Pins, MasterClock)) -> Self {
        Self {
            converter,
            pins,
            exposing: None,
            icg_rise: IcgRise::default(),
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
        self.pins.laser.set_exposure(laser, LONGEST_EXPOSURE);
        cortex_m::interrupt::free(|_| {
            let icg_fell = self.pins.raise_sh();
            self.pins.lower_sh(icg_fell);
            board::raise_icg_at(icg_fell.wrapping_add(ICG_LOW));
        });
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
            icg_rise,
            ..
        } = self;
        let exposed = core::mem::replace(exposing, laser);
        let mut word_0 = Err(ReadOutError::Late);
        let mut look = next;
        pins.laser.set_exposure(laser, LONGEST_EXPOSURE);
        let result = {
            let mut transfer = pin!(converter.read(&mut row[..]));
            let started = poll_fn(|context| {
                Poll::Ready(cortex_m::interrupt::free(|_| {
                    let icg_fell = pins.raise_sh();
                    let sh_fell = pins.lower_sh(icg_fell);
                    wait_until(icg_fell, TRANSFER_START);
                    // SCLK floats until the transfer enables SPI, so the converter listens only now.
                    pins.chip_select.set_low();
                    let started = transfer.as_mut().poll(context);
                    word_0 = pins.raise_icg_after_word_0(icg_fell, sh_fell, icg_rise);
                    look = Instant::now() + LOOK;
                    started
                }))
            });
            let result = started.await;
            end_read_out(transfer, result, word_0, CYCLES_A_PIXEL, [look, next]).await
        };
        self.pins.chip_select.set_high();
        result.map(|()| exposed)
    }
}

impl Pins {
    /// Lowers ICG and raises SH. Returns when ICG fell, just after a rise of fM.
    fn raise_sh(&mut self) -> u32 {
        // A rise of fM that is far enough ahead not to be missed.
        let icg_falls = board::master_clock_rose().wrapping_add(2 * CYCLES_A_MASTER_CLOCK);
        wait_until(icg_falls, 0);
        self.icg.set_low();
        wait_until(icg_falls, ICG_TO_SH);
        self.sh.set_high();
        icg_falls
    }

    /// Ends the exposure: lowers SH, and starts the laser. Returns when SH fell.
    fn lower_sh(&mut self, icg_fell: u32) -> u32 {
        wait_until(icg_fell, ICG_TO_SH + SH_HIGH);
        self.sh.set_low();
        let sh_fell = board::cycles();
        self.laser.start();
        sh_fell
    }

    /// Waits for the end of a word, and raises ICG on the rise of fM in word 3 that suits the words. If no
    /// word comes, ICG rises all the same, and the transfer runs into its timeout. Returns when word 0 ended,
    /// by the cycle counter.
    ///
    /// # Errors
    /// [`ReadOutError::Late`] if no word came, or if ICG rose too late, too soon after SH fell, or while fM
    /// was low.
    fn raise_icg_after_word_0(
        &mut self,
        icg_fell: u32,
        sh_fell: u32,
        icg_rise: &mut IcgRise,
    ) -> Result<u32, ReadOutError> {
        let word_0 = find_end_of_word_0(WORDS, CYCLES_A_PIXEL);
        let word_0_ended = word_0.unwrap_or_else(board::cycles);
        let wanted = word_0_ended.wrapping_sub(icg_fell) + ICG_AFTER_WORD_0;
        let rise = icg_rise.choose(wanted);
        let icg_rises = icg_fell.wrapping_add(rise);
        let since_master_clock_rose = board::raise_icg_at(icg_rises);
        let since_rise = board::cycles().wrapping_sub(icg_rises);
        let word_0_ended = word_0.ok_or(ReadOutError::Late)?;
        if since_master_clock_rose >= MASTER_CLOCK_HIGH
            || since_rise >= CYCLES_A_MASTER_CLOCK
            || (icg_rises.wrapping_sub(sh_fell) as i32) < SH_TO_ICG as i32
        {
            return Err(ReadOutError::Late);
        }
        let sampled = (SAMPLED + wanted).saturating_sub(rise) * 100 / CYCLES_A_PIXEL;
        COUNTERS.sampled_earliest.set_if_smaller(sampled);
        COUNTERS.sampled_latest.set_if_larger(sampled);
        Ok(word_0_ended)
    }
}
