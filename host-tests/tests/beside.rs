//! Rows on which a narrow spot stands beside wider light, or on it. The rows are not part of the repository.
//! Where they are absent the test says that it is skipped.

use crate::support::*;

/// A row's file, where its spot is in pixels of the light range, and whether a TCD1304 read it.
const CASES: [(&str, f64, bool); 5] = [
    // 460 counts with a width of 7 pixels, beside 300 counts with 55.
    ("hump-row-512px", 450.0, false),
    // 219 counts with 8.75 pixels, far from a wider, dimmer hump.
    ("hump-row-tcd1304-24", 216.98, true),
    // 1000 counts with 1.5 pixels, on a lamp.
    ("lamp-row-256px", 119.75, false),
    // 330 counts with 2 pixels, beside 180 counts with 13.
    ("negative-width-row-224px", 175.95, false),
    // 89 counts with 2.5 pixels, beside 20 counts with 150.
    ("hidden-hump150-row", 2404.6, true),
];

/// Every estimator finds the narrow spot, within five times its claim, or says that it is not sure.
#[test]
fn the_narrow_spot_beside_wider_light_is_measured_or_flagged() {
    let Some(folder) = shared_data("cases/rows") else {
        return;
    };
    for ((file, spot, is_tcd1304), estimator) in pairs(CASES, Estimator::ALL) {
        let text = std::fs::read_to_string(folder.join(format!("{file}.csv"))).expect("a row");
        let words = text.trim().split(',');
        let mut words: Vec<u16> = words.map(|word| word.parse().expect("a word")).collect();
        let geometry = match is_tcd1304 {
            true => tcd1304dg(),
            false => with(geometry(words.len(), 6554), |it| {
                (it.shielded, it.light.start) = (0..16, 16);
            }),
        };
        let options = options(|it| (it.rows, it.estimator) = (1, estimator));
        let measured = Measurement::new(geometry, options).row(&mut words);
        let name = estimator.name();
        match measured.expect("a frame of one row") {
            Err(fault) => println!("{file}, {name}: {}", fault.name()),
            Ok(found) => {
                let (frame, by_shape) = (found.frame, found.by_shape.to_f64());
                let off = frame.centre.to_f64() - spot;
                let u = frame.uncertainty.to_f64().hypot(by_shape);
                let is_flagged = frame.misfits > 0;
                println!("{file}, {name}: {off:+.3} px, u {u:.3}, flagged {is_flagged}");
                let is_near = off.abs() <= (5.0 * u).max(0.1);
                assert!(is_flagged || is_near, "{file}, {name}");
            }
        }
    }
}
