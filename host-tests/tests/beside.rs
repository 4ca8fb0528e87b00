//! Rows on which a narrow spot stands beside wider light, or on it. The rows are not part of the repository.
//! Where they are absent the test says that it is skipped.

use crate::support::*;
use std::io::Write as _;
use std::path::PathBuf;

/// The folder of the rows, if it is there. Says so if not.
fn folder() -> Option<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/cases/rows");
    let is_there = folder.is_dir();
    if !is_there {
        // Past the capture of a passing test's output.
        let (mut errors, folder) = (std::io::stderr(), folder.display());
        let _ = writeln!(errors, "SKIPPED: no rows in {folder}");
    }
    is_there.then_some(folder)
}

/// What a row's spot is, and the sensor that the row is from.
struct Case {
    file: &'static str,
    /// In pixels of the light range.
    spot: f64,
    is_tcd1304: bool,
}

const CASES: [Case; 5] = [
    // 460 counts with a width of 7 pixels, beside 300 counts with 55.
    Case {
        file: "hump-row-512px",
        spot: 450.0,
        is_tcd1304: false,
    },
    // 219 counts with 8.75 pixels, far from a wider, dimmer hump.
    Case {
        file: "hump-row-tcd1304-24",
        spot: 216.98,
        is_tcd1304: true,
    },
    // 1000 counts with 1.5 pixels, on a lamp.
    Case {
        file: "lamp-row-256px",
        spot: 119.75,
        is_tcd1304: false,
    },
    // 330 counts with 2 pixels, beside 180 counts with 13.
    Case {
        file: "negative-width-row-224px",
        spot: 175.95,
        is_tcd1304: false,
    },
    // 89 counts with 2.5 pixels, beside 20 counts with 150.
    Case {
        file: "hidden-hump150-row",
        spot: 2404.6,
        is_tcd1304: true,
    },
];

/// Every estimator finds the narrow spot, within five times its claim, or says that it is not sure.
#[test]
fn the_narrow_spot_beside_wider_light_is_measured_or_flagged() {
    let Some(folder) = folder() else {
        return;
    };
    for Case {
        file,
        spot,
        is_tcd1304,
    } in CASES
    {
        let text = std::fs::read_to_string(folder.join(format!("{file}.csv"))).expect("a row");
        let words = text
            .trim()
            .split(',')
            .map(|word| word.parse().expect("a word"));
        let words: Vec<u16> = words.collect();
        let geometry = if is_tcd1304 {
            sensor_heads::tcd1304dg()
        } else {
            Geometry {
                words: words.len(),
                shielded: 0..16,
                light: 16..words.len(),
                polarity: Polarity::Rising,
                bits: 12,
                shot_variance_per_count_q16: 6554,
                saturation: slitrange::row::LARGEST_COUNT,
            }
        };
        for estimator in Estimator::ALL {
            let options = options(|it| (it.rows, it.estimator) = (1, estimator));
            let mut measurement = Measurement::new(geometry.clone(), options);
            let measured = measurement
                .row(&mut words.clone())
                .expect("a frame of one row");
            let name = estimator.name();
            match measured {
                Err(fault) => println!("{file}, {name}: {}", fault.name()),
                Ok(found) => {
                    let off = found.frame.centre.to_f64() - spot;
                    let u = found
                        .frame
                        .uncertainty
                        .to_f64()
                        .hypot(found.by_shape.to_f64());
                    let is_flagged = found.frame.misfits > 0;
                    println!("{file}, {name}: {off:+.3} px, u {u:.3}, flagged {is_flagged}");
                    assert!(
                        is_flagged || off.abs() <= (5.0 * u).max(0.1),
                        "{file}, {name}"
                    );
                }
            }
        }
    }
}
