//! The answer to `selftest`: what the sensor can check by itself.

use core::fmt;

use crate::protocol::calibration::FlashStatus;
use crate::protocol::line::FaultLine;
use crate::protocol::status::StartCause;
use slitrange::base::fault::Fault;
use slitrange::base::units::Counts;
use slitrange::reading::Measured;
use slitrange::row::Row;
use slitrange::row::front_end::FrontEnd;

/// What a row says of the sensor head, in counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowTest {
    /// The mean of the shielded pixels. `None` if the sensor has none.
    black: Option<f32>,
    /// The standard deviation of the shielded pixels. `None` with fewer than two.
    noise: Option<f32>,
    /// The height of the spot, or why there is none.
    light: Result<Counts, Fault>,
}

impl RowTest {
    /// Looks at a row. `measured` is a frame of this row alone. `None` if the words are not those of a
    /// sensor.
    pub fn of(row: &Row<'_>, measured: &Result<Measured, Fault>) -> Option<Self> {
        if *measured == Err(Fault::SensorSilent) {
            return None;
        }
        let pixels = row.shielded();
        let mean = |sum: f32, count: usize| (count > 0).then(|| sum / count as f32);
        let counts = || pixels.iter().map(f32::from);
        let black = mean(counts().sum(), pixels.len());
        let squares = |black: f32| counts().map(|it| (it - black) * (it - black)).sum();
        let variance = black.and_then(|black| mean(squares(black), pixels.len().saturating_sub(1)));
        Some(Self {
            black,
            noise: variance.map(libm::sqrtf),
            light: match measured {
                Ok(measured) => Ok(measured.frame.amplitude),
                Err(fault) => Err(*fault),
            },
        })
    }
}

/// The answer to `selftest`, lines parted by CR LF. Each is `selftest`, what is checked, `pass` or `fail`,
/// and the value. The last line is `selftest pass`, or `selftest fail` and how many checks failed.
#[derive(Clone, Copy, Debug)]
pub struct Selftest<'a> {
    /// The state of flash.
    pub flash: FlashStatus,
    /// What made the firmware start.
    pub started_by: StartCause,
    /// Ten times the rows a second since the start.
    pub row_rate_tenths: u64,
    /// The front end, if it was measured.
    pub front_end: Option<&'a FrontEnd>,
    /// A row. `None` if none came.
    pub row: Option<RowTest>,
}

/// The least and the largest plausible black level in counts. Nearer to zero, the converter cuts the noise
/// off. Above, a third of the converter's range is lost.
const BLACK: (f32, f32) = (10.0, 1400.0);

/// The largest plausible noise of a pixel without light, in counts. No noise at all is that of a wire which
/// is not connected.
const LARGEST_NOISE: f32 = 30.0;

/// The noise of nine pixels is off by a factor of 4 in one of 7,500 rows (chi squared of 8 degrees below
/// 8 / 16).
const NOISE_FACTOR: f32 = 4.0;

/// The rounding of the converter, as a standard deviation in counts. A read noise does not contain it.
const ROUNDING: f32 = 0.3;

impl fmt::Display for Selftest<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut failed = 0u8;
        let mut word = |passes: bool| {
            failed = failed.saturating_add(u8::from(!passes));
            if passes { "pass" } else { "fail" }
        };
        let (is_readable, state) = match self.flash {
            FlashStatus::Nothing => (true, "nothing was saved"),
            FlashStatus::Record(_) => (true, "the last save"),
            FlashStatus::Older(_) => (false, "the save before the last one"),
            FlashStatus::Damaged => (false, "damaged"),
            FlashStatus::Later(_) => (false, "of later firmware"),
            FlashStatus::OtherSensor => (false, "of another sensor head"),
        };
        write!(f, "selftest flash {} {state}\r\n", word(is_readable))?;
        let rows = word(self.row.is_some());
        let (hertz, tenth) = (self.row_rate_tenths / 10, self.row_rate_tenths % 10);
        match self.row {
            Some(_) => write!(f, "selftest rows {rows} {hertz}.{tenth} Hz\r\n")?,
            None => write!(
                f,
                "selftest rows {rows} {}\r\n",
                FaultLine(&Fault::SensorSilent)
            )?,
        }
        if let Some(RowTest {
            black,
            noise,
            light,
        }) = self.row
        {
            if let Some(black) = black {
                let black_word = word(BLACK.0 <= black && black <= BLACK.1);
                let black = Counts::from_f32(black);
                write!(f, "selftest black {black_word} {black:.1} counts\r\n")?;
            }
            if let Some(noise) = noise {
                let (least, most) = match self.front_end {
                    Some(front_end) => {
                        let expected = front_end.read_noise.value.to_f32();
                        (expected / NOISE_FACTOR, expected * NOISE_FACTOR)
                    }
                    None => (0.0, LARGEST_NOISE),
                };
                let noise_word =
                    word(noise > 0.0 && least <= noise + ROUNDING && noise <= most + ROUNDING);
                let noise = Counts::from_f32(noise);
                write!(f, "selftest noise {noise_word} {noise:.2} counts\r\n")?;
            }
            match light {
                Ok(height) => write!(f, "selftest light {} {height:.0} counts\r\n", word(true))?,
                Err(fault) => {
                    let fault = FaultLine(&fault);
                    write!(f, "selftest light {} {fault}\r\n", word(false))?;
                }
            }
        }
        let start = word(match self.started_by {
            StartCause::PowerOn | StartCause::ResetPin | StartCause::Software => true,
            StartCause::SupplyDip | StartCause::Watchdog => false,
        });
        write!(f, "selftest start {start} {}\r\n", self.started_by)?;
        match failed {
            0 => f.write_str("selftest pass"),
            failed => write!(f, "selftest fail {failed}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use slitrange::base::units::Electrons;
    use slitrange::row::front_end::Estimate;
    use slitrange::row::sensor_heads::tcd1304dg;
    use slitrange::{Measurement, Options};
    use std::string::{String, ToString as _};

    /// A row test of shielded pixels that alternate between two counts, with a spot or without one.
    fn row(dark: [u16; 2], spot: f64) -> Option<RowTest> {
        let geometry = tcd1304dg();
        let mut words: std::vec::Vec<u16> = (0..geometry.words)
            .map(|i| {
                let u = (i as f64 - geometry.light.start as f64 - 1800.0) / 9.0;
                4095 - dark[i % 2] - (spot * (-0.5 * u * u).exp()) as u16
            })
            .collect();
        let options = Options {
            rows: 1,
            ..Options::default()
        };
        let measured = Measurement::new(tcd1304dg(), options)
            .row(&mut words)
            .expect("a frame");
        let row = geometry.row(&words).expect("a row");
        RowTest::of(&row, &measured)
    }

    fn good() -> Selftest<'static> {
        Selftest {
            flash: FlashStatus::Record(1),
            started_by: StartCause::PowerOn,
            row_rate_tenths: 1754,
            front_end: None,
            row: row([299, 301], 2000.0),
        }
    }

    /// The lines of a test that fail, without their first word.
    fn failed(test: &Selftest<'_>) -> std::vec::Vec<String> {
        let text = test.to_string();
        println!("{text}");
        let lines = text.split("\r\n").map(|line| {
            let line = line.strip_prefix("selftest ").expect("its first word");
            line.to_string()
        });
        lines.filter(|line| line.contains("fail")).collect()
    }

    #[test]
    fn a_good_sensor_passes() {
        let text = good().to_string();
        assert!(
            text.starts_with(
                "selftest flash pass the last save\r\nselftest rows pass 175.4 Hz\r\n\
                 selftest black pass "
            ),
            "{text}"
        );
        // Nine pixels, of which five are one count below the middle: 80 / 9 counts squared over 8.
        assert!(
            text.contains("\r\nselftest noise pass 1.05 counts\r\n"),
            "{text}"
        );
        assert!(text.contains("\r\nselftest light pass "), "{text}");
        assert!(text.ends_with("\r\nselftest start pass power-on\r\nselftest pass"));
        let new = Selftest {
            flash: FlashStatus::Nothing,
            ..good()
        };
        assert_eq!(failed(&new), [""; 0]);
    }

    #[test]
    fn each_check_can_fail() {
        let flash = |flash| Selftest { flash, ..good() };
        let of_row = |row| Selftest { row, ..good() };
        for (test, line) in [
            (flash(FlashStatus::Damaged), "flash fail damaged"),
            (flash(FlashStatus::Later(2)), "flash fail of later firmware"),
            (
                flash(FlashStatus::Older(1)),
                "flash fail the save before the last one",
            ),
            (
                flash(FlashStatus::OtherSensor),
                "flash fail of another sensor head",
            ),
            (of_row(None), "rows fail f sensor silent"),
            (of_row(row([7, 9], 2000.0)), "black fail 8.0 counts"),
            (
                of_row(row([1499, 1501], 2000.0)),
                "black fail 1500.0 counts",
            ),
            (of_row(row([300, 300], 2000.0)), "noise fail 0.00 counts"),
            (of_row(row([299, 301], 0.0)), "light fail f no spot"),
        ] {
            let failed = failed(&test);
            assert_eq!(failed.len(), 2, "{failed:#?}");
            // The mean of nine pixels is off by up to 0.2.
            let is_near = |a: &str, b: &str| a.split(' ').take(2).eq(b.split(' ').take(2));
            assert!(is_near(&failed[0], line), "{failed:#?}");
            assert_eq!(failed[1], "fail 1");
        }
        for (started_by, line) in [
            (StartCause::Watchdog, "start fail watchdog"),
            (StartCause::SupplyDip, "start fail supply dip"),
        ] {
            let restarted = Selftest {
                started_by,
                ..flash(FlashStatus::Damaged)
            };
            assert_eq!(failed(&restarted), ["flash fail damaged", line, "fail 2"]);
        }
    }

    /// With a front end that was measured, the noise must be that of the measurement.
    #[test]
    fn the_noise_is_that_of_the_front_end() {
        let front_end = |noise| FrontEnd {
            polarity: tcd1304dg().polarity,
            gain: Estimate {
                value: Electrons::from_int(10),
                u: Electrons::from_int(1),
            },
            read_noise: Estimate {
                value: Counts::from_f32(noise),
                u: Counts::from_f32(0.01),
            },
            saturation: None,
            black_level: Estimate {
                value: Counts::from_int(300),
                u: Counts::from_int(1),
            },
        };
        for (noise, passes) in [
            (0.15, false),
            (0.25, true),
            (1.0, true),
            (2.8, true),
            (5.0, true),
            (5.6, false),
        ] {
            let front_end = front_end(noise);
            let test = Selftest {
                front_end: Some(&front_end),
                ..good()
            };
            assert_eq!(failed(&test).is_empty(), passes, "{noise}");
        }
    }
}
