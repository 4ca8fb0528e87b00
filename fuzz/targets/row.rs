//! Rows of whatever a sensor may deliver, through the whole pipeline: what comes out is a reading that can be
//! true, or a fault.
//!
//! The input is a list of steps of 8 bytes: what to do, a byte `a`, and three words `b`, `c`, `d`, low byte
//! first. They paint a row of light and hand it over; see [`Bench::step`]. Bytes behind the last
//! whole step have no effect.
#![no_main]
#![forbid(unsafe_code)]

use libfuzzer_sys::fuzz_target;
use slitrange::frame::comb::{Comb, FEWEST, Slits};
use slitrange::frame::{FEWEST_INDEPENDENT, MAX_ROWS};
use slitrange::spot::region::Region;
use slitrange::{
    BlackLevel, Calibration, CalibrationErrors, Counts, Estimator, Fault, Geometry, Mean,
    Measurement, Micrometres, Options, Pixels, Polarity, Reading, Surface, sensor_heads,
};
use slitrange_device::protocol::advice::advice;
use slitrange_device::protocol::line::{FaultLine, ReadingLine};

/// Rows at most, so that an input takes a few milliseconds.
const MAX_ROWS_OF_INPUT: usize = 24;

fuzz_target!(|bytes: &[u8]| {
    let mut bench = Bench::new(geometry(bytes.first().copied().unwrap_or_default()));
    for &[what, a, b0, b1, c0, c1, d0, d1] in bytes.as_chunks().0 {
        let words = [[b0, b1], [c0, c1], [d0, d1]].map(u16::from_le_bytes);
        bench.step(what >> 4, a, words);
    }
});

/// The first step's low half says which sensor.
fn geometry(first: u8) -> Geometry {
    let short = |light: usize, bits, polarity| Geometry {
        words: light + 8,
        shielded: 1..5,
        light: 6..6 + light,
        polarity,
        bits,
        shot_variance_per_count_q16: 6554,
        saturation: slitrange::row::LARGEST_COUNT,
    };
    let with = |mut geometry: Geometry, change: fn(&mut Geometry)| {
        change(&mut geometry);
        geometry
    };
    match first & 0xF {
        0 => sensor_heads::tcd1304dg(),
        1 => short(142, 8, Polarity::Rising),
        2 => short(31, 12, Polarity::Rising),
        3 => short(64, 12, Polarity::Falling),
        4 => short(0, 12, Polarity::Rising),
        5 => short(4096, 12, Polarity::Rising),
        6 => short(128, 1, Polarity::Rising),
        7 => with(short(200, 255, Polarity::Falling), |it| {
            it.shot_variance_per_count_q16 = u16::MAX;
        }),
        8 => with(short(250, 12, Polarity::Rising), |it| {
            it.shielded = 300..200
        }),
        9 => with(short(100, 12, Polarity::Rising), |it| {
            it.light = 0..usize::MAX
        }),
        10 => with(short(400, 10, Polarity::Rising), |it| {
            (it.shot_variance_per_count_q16, it.saturation) = (0, 700);
        }),
        _ => short(512, 12, Polarity::Falling),
    }
}

/// Only some values mean a bit.
fn stuck_bit(which: u8) -> u16 {
    if which & 0xF0 == 0xF0 {
        1 << (which & 0xF)
    } else {
        0
    }
}

struct Bench {
    geometry: Geometry,
    light: Vec<f64>,
    options: Options,
    calibration: Option<Calibration>,
    measurement: Measurement,
    /// Rows of the frame that is under way.
    rows: u16,
    left: usize,
}

impl Bench {
    fn new(geometry: Geometry) -> Self {
        let options = Options {
            rows: 1,
            ..Options::default()
        };
        Self {
            light: vec![300.0; geometry.light.len().min(5000)],
            measurement: Measurement::new(geometry.clone(), options),
            geometry,
            options,
            calibration: None,
            rows: 0,
            left: MAX_ROWS_OF_INPUT,
        }
    }

    fn step(&mut self, what: u8, a: u8, [b, c, d]: [u16; 3]) {
        // Places to a sixteenth of a pixel, heights in counts, beyond full scale too.
        let (place, height) = (f64::from(b) / 16.0, f64::from(c % 16384) - 4096.0);
        // From 1/16 of a pixel to 224.
        let width = match a {
            0..=95 => f64::from(a + 1) / 16.0,
            _ => f64::from(a - 90) * 1.36,
        };
        let pixels = self.light.iter_mut().zip(0u32..);
        let pixels = pixels.map(|(light, i)| (light, f64::from(i)));
        match what {
            0 => self.light.fill(f64::from(b % 4096)),
            1 => pixels.for_each(|(light, i)| {
                let u = (i - place) / width;
                *light += height * (-0.5 * u * u).exp();
            }),
            2 => pixels.for_each(|(light, i)| {
                // A slit's diffraction pattern.
                let u = (i - place) / (0.85 * width);
                *light += height * if u == 0.0 { 1.0 } else { (u.sin() / u).powi(2) };
            }),
            3 => {
                let inside = pixels.filter(|(_, i)| (i - place).abs() < width);
                inside.for_each(|(light, _)| *light += height);
            }
            4 => {
                pixels.for_each(|(light, i)| *light += (i - place) * (f64::from(a) - 128.0) / 25.0)
            }
            5 => pixels.for_each(|(light, i)| *light += height * (i * f64::from(a) / 64.0).sin()),
            6 => {
                if let Some(light) = self.light.get_mut(usize::from(b)) {
                    *light = height;
                }
            }
            7 => {
                let by = usize::from(b) % self.light.len().max(1);
                self.light.rotate_right(by);
            }
            8 => {
                let keep = usize::from(b).min(self.light.len());
                self.light[..keep].reverse();
            }
            9 => self.set(a, [b, c, d]),
            10 => self.silence(),
            12 => {
                // Images of a comb, some of them missing.
                for (slit, bit) in Comb::nominal().slits().iter().zip(0..) {
                    let centre = slit.from_axis(Pixels::from_f32(place as f32)).to_f64();
                    let height = if d >> bit & 1 == 0 { height } else { 0.0 };
                    for (light, i) in self.light.iter_mut().zip(0u32..) {
                        let u = (f64::from(i) - centre) / width;
                        *light += height * (-0.5 * u * u).exp();
                    }
                }
            }
            11 => self.read(usize::from(c % 5000), a, [b, 0, 0]),
            // A row with noise of a tenth of `b` counts, seeded, with some bits of its words stuck.
            _ => {
                for row in 0..=a % 16 {
                    self.read(self.geometry.words, a ^ row, [b, c, d]);
                }
            }
        }
    }

    fn set(&mut self, a: u8, [b, c, d]: [u16; 3]) {
        let estimators = Estimator::ALL;
        self.options = Options {
            rows: if b & 0x8000 != 0 { b } else { b % 20 },
            mean: [Mean::Weighted, Mean::Plain][usize::from(a & 1)],
            estimator: estimators[usize::from(c) % estimators.len()],
            black_level: match a >> 1 & 3 {
                0 => BlackLevel::Shielded,
                1 => BlackLevel::Frame,
                _ => BlackLevel::Fixed(Counts::from_int(i32::from(d))),
            },
            slits: Slits::ALL[usize::from(a >> 6 & 1)],
            ..Options::default()
        };
        self.calibration = Calibration::nominal().filter(|_| a & 0x80 != 0);
        self.measurement.set(self.options, None);
        self.rows = 0;
    }

    fn silence(&mut self) {
        assert_eq!(self.measurement.silence(), Fault::SensorSilent);
        self.rows = 0;
    }

    /// Hands a row of so many words over.
    fn read(&mut self, words: usize, seed: u8, [noise, c, stuck]: [u16; 3]) {
        if self.left == 0 {
            return;
        }
        self.left -= 1;
        let noise = f64::from(noise % 2048) / 10.0;
        let mut random = u64::from(seed) << 16 | u64::from(c);
        let mut next = || {
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (random >> 40) as f64 / (1 << 24) as f64 - 0.5
        };
        let full_scale = self.geometry.full_scale();
        let [zero, one] = stuck.to_le_bytes().map(stuck_bit);
        let mut row: Vec<u16> = (0..words)
            .map(|i| {
                let pixel = i.checked_sub(self.geometry.light.start);
                let light = pixel.and_then(|pixel| self.light.get(pixel));
                // `as` saturates.
                let count = (light.unwrap_or(&300.0) + noise * 3.46 * next() + 0.5) as u16;
                let count = count.min(full_scale);
                let word = match self.geometry.polarity {
                    Polarity::Rising => count,
                    Polarity::Falling => full_scale - count,
                };
                word & !zero | one
            })
            .collect();
        self.rows += 1;
        let result = self.measurement.row(&mut row);
        let due = self.rows >= self.options.rows.clamp(1, MAX_ROWS as u16);
        assert_eq!(result.is_some(), due, "after {} rows", self.rows);
        let Some(result) = result else {
            return;
        };
        self.rows = 0;
        let (calibration, errors) = (self.calibration.as_ref(), CalibrationErrors::Nominal);
        match result.and_then(|it| it.reading(calibration, &errors, Surface::Auto)) {
            Ok(reading) => self.check(&reading),
            Err(fault) => self.check_fault(fault),
        }
    }

    fn check(&self, reading: &Reading) {
        let said = ReadingLine(reading).to_string();
        assert!(said.starts_with("d ") && said.is_ascii(), "{said}");
        let calibration = self.calibration.as_ref().expect("no distance without one");
        self.check_centre(reading.centre, reading.centre_uncertainty);
        let range = calibration.distances().expect("the ends are in the range");
        assert!(range.contains(&reading.distance), "{said}");
        assert!(reading.uncertainty >= Micrometres::default(), "{reading:?}");
        assert!(reading.width > Pixels::default(), "{reading:?}");
        assert!(reading.amplitude > Counts::default(), "{reading:?}");
        let asked = self.options.rows.clamp(1, MAX_ROWS as u16);
        assert_eq!(reading.rows, asked, "{reading:?}");
        // More than half of the rows have a centre, two thirds of those fit, and two thirds of those agree.
        let (used, rows) = (reading.rows_used, reading.rows);
        assert!(9 * used >= 2 * rows && used <= rows, "{reading:?}");
        assert!(reading.misfits <= reading.rows_used, "{reading:?}");
        let is_few = |worth| (1..FEWEST_INDEPENDENT).contains(&worth);
        assert!(reading.correlated.is_none_or(is_few), "{reading:?}");
        assert_eq!(reading.estimator, self.options.estimator);
        match self.options.slits {
            Slits::One => assert_eq!(reading.slits_used, 1),
            Slits::Comb => assert!(usize::from(reading.slits_used) >= FEWEST, "{reading:?}"),
        }
    }

    /// It is on the row, and not certain beyond its resolution.
    fn check_centre(&self, centre: Pixels, uncertainty: Pixels) {
        let pixels = self.geometry.light.len() as f64;
        let place = centre.to_f64();
        let is_there = match self.options.slits {
            Slits::One => place >= -0.5 && place <= pixels - 0.5,
            // Where a slit on the axis would show the spot: it may lie beyond the row.
            Slits::Comb => place.abs() < 5000.0,
        };
        assert!(is_there, "{centre} of {pixels}");
        assert!(uncertainty > Pixels::default(), "{centre}: {uncertainty}");
    }

    fn check_fault(&self, fault: Fault) {
        let said = format!("{} {}", FaultLine(&fault, Region::ALL), advice(&fault));
        assert!(said.starts_with("f ") && said.is_ascii(), "{said}");
        match fault {
            Fault::NotCalibrated {
                centre,
                uncertainty,
            } => {
                assert!(self.calibration.is_none());
                self.check_centre(centre, uncertainty);
            }
            Fault::OutOfRange { centre } => self.check_centre(centre, Pixels::MAX),
            Fault::Saturated { pixels } => assert!(pixels > 0),
            Fault::Unsteady { scatter } => assert!(scatter > Pixels::from_int(0)),
            Fault::TwoSpots { centre, other } => assert_ne!(centre, other),
            Fault::FewSlits { found, needed } => assert!(found < needed),
            Fault::SlitsUnclear { .. } => assert_eq!(self.options.slits, Slits::Comb),
            Fault::SensorSilent
            | Fault::NoSpot { .. }
            | Fault::TooDim { .. }
            | Fault::SpotAtEdge { .. } => {}
            Fault::LaserOff => assert!(!self.options.laser),
            // Rows come here without their exposure.
            Fault::DimAtLongest { .. } | Fault::SaturatedAtShortest { .. } => {
                panic!("{fault}: nothing chose an exposure")
            }
            Fault::Spike { .. } => panic!("{fault}: a measurement knows no spikes"),
        }
    }
}
