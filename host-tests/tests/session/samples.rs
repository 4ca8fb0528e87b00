//! Frames, faults, rows and records by the words of a script.

use crate::support::*;
use slitrange::row::pixels::map::MapSummary;
use slitrange_device::protocol::info::{BrownOut, Clock, Hardware};
use slitrange_device::protocol::selftest::RowTest;

pub const HARDWARE: Hardware = Hardware {
    board: "a board",
    head: "TCD1304DG",
    row_us: 5700,
    longest_exposure: Exposure::LONGEST,
    clock: Clock::External,
    brown_out: BrownOut::Off,
    last_stop: None,
};

fn number<T: std::str::FromStr>(word: &str) -> T {
    word.parse()
        .ok()
        .unwrap_or_else(|| panic!("no number: {word}"))
}

/// A frame whose spot is at a centre in pixels, and what else is particular: `1800 us 187 u 0.2`.
pub fn frame(words: &[&str]) -> Measured {
    let mut measured = at_centre(number(words[0]));
    measured.pixels = PixelErrors::TCD1304DG;
    let frame = &mut measured.frame;
    frame.uncertainty = Pixels::from_f32(0.002);
    frame.amplitude = Counts::from_int(1993);
    let (parts, _) = words[1..].as_chunks();
    for &[name, value] in parts {
        match name {
            "us" => frame.exposure = Exposure::from_us(number(value)),
            "misfits" => frame.misfits = number(value),
            "correlated" => frame.correlated = Some(number(value)),
            "u" => frame.uncertainty = Pixels::from_f32(number(value)),
            "used" => frame.rows_used = number(value),
            "width" => frame.shape.width = Pixels::from_f32(number(value)),
            "components" => {
                let components = [1.0, -31.0, 123.0, 0.0, -125_000.0];
                let scale: f32 = number(value);
                frame.shape.components = components.map(|it| Pixels::from_f32(it * scale));
            }
            "map" => measured.pixels = map_summary().errors,
            // The last slit has no image, the one before it too few rows.
            "slits" => {
                let slits: usize = number(value);
                let image = |i| SlitCentre {
                    centre: Pixels::from_f32(912.125 + 100.0 * i as f32),
                    height: 1830,
                    rows: (if i + 1 < slits { 8 } else { 7 })
                        .try_into()
                        .expect("rows"),
                };
                measured.comb = Some(Combined {
                    shift: Pixels::default(),
                    surface: Pixels::from_f32(0.5),
                    used: slits as u8,
                    centres: std::array::from_fn(|i| (i < slits).then(|| image(i))),
                });
            }
            other => panic!("no part of a frame: {other}"),
        }
    }
    measured
}

pub fn fault(words: &[&str]) -> Fault {
    match words {
        ["no", "spot"] => Fault::NoSpot {
            amplitude: Counts::from_int(9),
        },
        ["too", "dim"] => {
            let [amplitude, needed] = [35, 60].map(Counts::from_int);
            Fault::TooDim { amplitude, needed }
        }
        ["two", "spots"] => {
            let [centre, other] = [1200.25, 1810.5].map(Pixels::from_f32);
            Fault::TwoSpots { centre, other }
        }
        ["few", "slits"] => few_slits(3),
        ["unclear", "slits"] => {
            let (images, other) = (6, 5);
            Fault::SlitsUnclear { images, other }
        }
        ["saturated"] => Fault::Saturated { pixels: 12 },
        other => panic!("no fault: {other:?}"),
    }
}

pub fn map_summary() -> MapSummary {
    MapSummary {
        errors: pixel_errors(34, 66),
        pattern: Counts::from_int(5),
        outside: 2,
    }
}

/// A test of a row whose shielded pixels alternate between two counts, with a spot of a height: `299 301
/// 2000`. None if the sensor is silent.
pub fn row_test(words: &[&str]) -> Option<RowTest> {
    let &[dark, bright, spot] = words else {
        return None;
    };
    let (dark, spot): ([u16; 2], f64) = ([dark, bright].map(number), number(spot));
    let geometry = tcd1304dg();
    let word = |i: usize| {
        let u = (i as f64 - geometry.light.start as f64 - 1800.0) / 9.0;
        4095 - dark[i % 2] - (spot * (-0.5 * u * u).exp()) as u16
    };
    let mut words: Vec<u16> = (0..geometry.words).map(word).collect();
    let measured = Measurement::new(tcd1304dg(), options(|it| it.rows = 1)).row(&mut words);
    let row = geometry.row(&words).expect("a row");
    RowTest::of(&row, &measured.expect("a frame"))
}

/// A record of the nominal calibration, with what the words name.
pub fn record(words: &[&str]) -> EncodedRecord {
    let mut record = Record::nominal().expect("a record");
    let knots = [(1200, 1_000_000), (2000, 700_000), (2600, 555_000)];
    let knots = knots.map(|(centre, um)| knot(centre, um));
    for word in words {
        match *word {
            "nominal" => {}
            "own" => {
                record.serial_number = 42;
                record.date = Date::new(2026, 11, 21).expect("a day");
                record.black_level = BlackLevel::Frame;
            }
            "fixed" => record.black_level = BlackLevel::Fixed(Counts::from_int(4095)),
            "gauss-newton" => record.estimator = Estimator::GaussNewton,
            "rising" => record.geometry.polarity = Polarity::Rising,
            "unfitted" => record.errors = CalibrationErrors::Unknown,
            "fitted" => {
                let rising: [_; PLACES] = std::array::from_fn(|i| 10 + i as i32);
                let deviation = rising.map(|um| Micrometres::from_int(20 * um));
                let curve = rising.map(Micrometres::from_int);
                record.errors = fitted(curve, deviation, [Counts::from_int(1000); PLACES]);
            }
            "table" => {
                record.calibration = Calibration::Table(Table::new(&knots).expect("a table"));
            }
            "residuals" => {
                let residuals = [1200, 2000, 2600].map(|centre| knot(centre, 100));
                let curve = NOMINAL.expect("a curve");
                let corrected = Corrected::new(curve, &residuals).expect("usable");
                record.calibration = Calibration::Corrected(corrected);
            }
            "spot" => {
                record.profile = Some(Profile {
                    first: Pixels::from_int(1000),
                    last: Pixels::from_int(2600),
                    width: [Pixels::from_int(8); PLACES],
                    width_deviation: Pixels::from_f32(0.01),
                    components: [[Pixels::from_f32(0.125); PLACES]; COMPONENTS],
                    deviation: Pixels::from_f32(0.001),
                });
            }
            "comb" => {
                let slit = |place| SlitMap::nominal(place).corrected([Pixels::from_f32(0.5); 4]);
                let slits = [-3000, -1000, 100, 1500, 2600].map(slit);
                record.comb = Some(Comb::new(&slits).expect("ascending"));
            }
            "front-end" => record.front_end = Some(front_end(5.25)),
            "dim" => record.front_end = Some(with(front_end(5.25), |it| it.saturation = None)),
            noise => record.front_end = Some(front_end(number(noise))),
        }
    }
    EncodedRecord::new(record).expect("a record")
}

/// A front end that differs from the one that the driver assumes.
fn front_end(noise: f32) -> FrontEnd {
    let counts = |value, u| estimate([value, u].map(Counts::from_f32));
    FrontEnd {
        polarity: Polarity::Rising,
        gain: estimate([8.125, 0.06].map(Electrons::from_f32)),
        read_noise: counts(noise, 0.0625),
        saturation: Some(counts(2700.5, 0.25)),
        black_level: counts(320.0, 0.125),
    }
}
