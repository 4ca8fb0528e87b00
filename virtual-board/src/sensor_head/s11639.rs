//! The Hamamatsu S11639-01: its limits, and what its pins do. Its CLK is at PE9, its ST at PF12.
//!
//! **Exposure.** The pixels gather light while ST is high and for 48 periods of CLK after its fall.
//!
//! **Read-out.** The first rise of CLK after ST fell is number 1. Pixel n, from 0, is at the output from half
//! a period before rise 89 + n to half a period after that rise. The output rises with light.
//!
//! Nobody has checked the numbers marked "assumed" against the data sheet (KMPD1163E).

use std::ops::RangeInclusive;

use super::{Clocks, Exposure, Level, ReadOut, SensorHead};
use crate::Nanos;

/// Pixels in a row. All see light (data sheet, structure).
pub const PIXELS: usize = 2048;

/// Words in a row: the converter runs before the first pixel comes, and after the last.
pub const WORDS: usize = slitrange::row::sensor_heads::s11639().words;

/// The firmware's time from one row to the next by its own clock, s.
pub const ROW_PERIOD: f64 = 3.33e-3;

/// CLK, Hz (data sheet, clock pulse frequency).
pub const CLOCK: RangeInclusive<f64> = 0.2e6..=10e6;

/// The least time that ST stays high, periods of CLK (assumed).
const ST_HIGH: f64 = 6.0;

/// The least time that ST stays low, periods of CLK (assumed).
const ST_LOW: f64 = 100.0;

/// ST's fall ends the exposure so many periods of CLK later (as drmcnelson's S11639-01 project computes it).
const STILL_EXPOSED: f64 = 48.0;

/// The rise of CLK, from 1, in the middle of the first pixel's time (assumed). The data sheet's highest rate,
/// 4672 rows a second at 10 MHz, says that a row takes 2140 periods: 92 beside those of the pixels. So the
/// number can be wrong by a few periods at most.
const FIRST_PIXEL: f64 = 89.0;

/// When ST may fall, in parts of CLK's period since CLK rose: not so near to a rise of CLK that it is open
/// which rise is the first (assumed: 30 ns, rise and fall times included).
const ST_FALLS: RangeInclusive<f64> = 0.05..=0.95;

impl SensorHead {
    /// Sets ST to `level`.
    pub(super) fn st(&mut self, level: Level, now: Nanos) {
        let (rose, fell) = (self.icg.rose, self.icg.fell);
        if !self.icg.moves(level, now) {
            return;
        }
        let Some(period) = self.clock_period() else {
            return;
        };
        let periods = |since: Nanos| (now - since) as f64 / period;
        match level {
            Level::Low => {
                if let (Some(_), Some(burst)) = (&self.read_out, &self.burst)
                    && (8..WORDS).contains(&burst.words.len())
                {
                    let words = burst.words.len();
                    self.violated(
                        now,
                        format!("ST fell after word {words} of {WORDS}: the row is cut short"),
                    );
                }
                self.read_out = None;
                if let Some(rose) = rose
                    && periods(rose) < ST_HIGH
                {
                    let what = format!("ST was high for {:.1} periods of CLK", periods(rose));
                    self.violated(now, format!("{what}; at least {ST_HIGH} (S11639)"));
                }
                let end = now + (STILL_EXPOSED * period) as Nanos;
                let start = rose.unwrap_or(0);
                self.handed_over = Some(Exposure {
                    start,
                    end,
                    laser: self.laser_within(start..end),
                });
            }
            Level::High => {
                // Without a rate limit the firmware's times are shorter, and CLK's period is not.
                if let Some(fell) = fell
                    && self.has_rate_limit
                    && periods(fell) < ST_LOW
                {
                    let what = format!("ST was low for {:.1} periods of CLK", periods(fell));
                    self.violated(now, format!("{what}; at least {ST_LOW} (S11639)"));
                }
            }
        }
    }

    /// CLK's period, ns. `None` before it is known.
    fn clock_period(&self) -> Option<f64> {
        let hz = self.clocks?.master_hz;
        (hz > 0.0).then(|| 1e9 / hz)
    }

    /// ST has fallen when this part of CLK's period had passed since CLK rose.
    pub(crate) fn st_fell_at(&mut self, part: f64, clocks: Clocks, now: Nanos) {
        let Some(exposure) = self.handed_over.take() else {
            return;
        };
        if !ST_FALLS.contains(&part) {
            let (least, most) = (ST_FALLS.start() * 100.0, ST_FALLS.end() * 100.0);
            let what = format!("ST fell at {:.0} % of CLK's period", part * 100.0);
            self.violated(
                now,
                format!("{what}; within {least} % to {most} % (S11639)"),
            );
        }
        let period = 1e9 / clocks.master_hz;
        let rise = now as f64 + (1.0 - part) * period;
        let counts = self.expose(&exposure, now);
        self.unlit = counts.iter().copied().min().unwrap_or_default();
        self.read_out = Some(ReadOut {
            exposure,
            began: (rise + (FIRST_PIXEL - 1.5) * period) as Nanos,
            counts,
            clocks_reported: false,
        });
    }
}

#[cfg(test)]
mod tests;
