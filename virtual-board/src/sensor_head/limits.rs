//! The limits that the firmware must keep. A violated limit is an error of the run.

use std::ops::{Range, RangeInclusive};

use crate::base::Nanos;

/// Outputs of the TCD1304DG in a row: 32 before the light-sensitive ones, 3648 of those, 14 after (data
/// sheet, timing chart 1).
pub const PIXELS: usize = 3694;

/// The light-shielded outputs among them (data sheet, timing chart 1).
pub const SHIELDED: Range<usize> = 16..29;

/// Periods of the master clock fM for which a pixel stays at the output (data sheet, timing chart 1).
pub const MASTER_CLOCKS_PER_PIXEL: f64 = 4.0;

/// The time from ICG's fall to SH's rise, ns (data sheet, timing requirements, t2).
pub const SH_AFTER_ICG: RangeInclusive<Nanos> = 100..=1000;

/// The least time that SH stays high, ns (data sheet, timing requirements, t3).
pub const SH_HIGH: Nanos = 1000;

/// The least time from SH's fall to ICG's rise, ns (data sheet, timing requirements, t1).
pub const ICG_AFTER_SH: Nanos = 1000;

/// When ICG may rise, in parts of fM's period since fM rose: while fM is high (data sheet, timing
/// requirements, t4), and so long before its fall that buffers and waits for flash have room. TIM1 counts 64
/// in a period, and fM falls at 32.
pub const ICG_RISES: RangeInclusive<f64> = 0.0..=28.0 / 64.0;

/// The least exposure, ns: the time from the end of one SH pulse to the end of the next (data sheet, timing
/// requirements, tINT).
pub const EXPOSURE: Nanos = 10_000;

/// The master clock fM, Hz (data sheet, operating range at 3.0 V and more).
pub const MASTER_CLOCK: RangeInclusive<f64> = 0.8e6..=4.0e6;

/// The largest relative difference between the time of a pixel and of a conversion. A row has 3694 of each:
/// with a larger difference they drift apart by more than a third of a pixel.
pub const RATE_MISMATCH: f64 = 1e-4;

/// The range of SCLK, Hz, for which the converter's accuracy is specified (ADC122S101 data sheet, electrical
/// characteristics).
pub const SERIAL_CLOCK: RangeInclusive<f64> = 8e6..=16e6;

/// SCLK periods of a conversion, and bits of a word (ADC122S101 data sheet, serial interface).
pub const WORD_BITS: u8 = 16;

/// SCLK periods from the begin of a conversion until the converter holds its input: the fourth falling edge
/// (ADC122S101 data sheet, track and hold).
pub const HOLD_AFTER: f64 = 3.5;

/// The part of a pixel's time after which the converter may hold it: so late that the sensor's output and the
/// converter's input have settled, and so early that it does not hold the next pixel.
pub const HOLD_PHASE: RangeInclusive<f64> = 0.20..=0.95;

/// The core-coupled RAM of an STM32F4, which no DMA controller reaches, though the emulator's does (RM0090,
/// table 1 and section 2.3.1).
pub const CORE_COUPLED_RAM: Range<u64> = 0x1000_0000..0x1001_0000;
