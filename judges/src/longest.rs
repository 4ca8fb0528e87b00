//! The parts of the longest record: their numbers take all bytes that they can.

use slitrange::distance::eq1::Eq1;
use slitrange::distance::knots::{Knot, MAX_KNOTS};
use slitrange::distance::residuals::Corrected;
use slitrange::frame::comb::{CORRECTIONS, Comb, LARGEST_CORRECTION, SlitMap};
use slitrange::row::front_end::{Estimate, FrontEnd, LARGEST_GAIN};
use slitrange::{Calibration, Counts, Micrometres, Pixels, Polarity};

/// Eq. (1) with the most knots: centres beyond 2048 pixels, residuals beyond 0.52 m, and a K of 55 bits.
///
/// # Panics
/// If the core refuses the numbers.
pub fn calibration() -> Calibration {
    let at = |i: i32| Knot {
        centre: Pixels::from_bits((2048 << 16) + i * 800_000),
        value: Micrometres::from_int(2_000_000 + i),
    };
    let knots: Vec<Knot> = (0..MAX_KNOTS as i32).map(at).collect();
    let (d, pole) = (Micrometres::from_int(-7_000_000), Pixels::from_int(-32_768));
    let centres = knots[0].centre..=knots[MAX_KNOTS - 1].centre;
    let curve = Eq1::new(d, 1 << 54, pole, centres);
    let curve = curve.expect("7.9 m to 7.6 m, less 7 m");
    Calibration::Corrected(Corrected::new(curve, &knots).expect("usable"))
}

/// A comb whose slits are 8193 um or more from the middle.
///
/// # Panics
/// If the core refuses the numbers.
pub fn comb() -> Comb {
    let most = Pixels::from_int(LARGEST_CORRECTION);
    let places = (0..8).map(|i| i - 16_384).chain((0..8).map(|i| i + 8_193));
    let slit = |place| SlitMap::nominal(place).corrected([most; CORRECTIONS]);
    Comb::new(&places.map(slit).collect::<Vec<_>>()).expect("ascending")
}

/// A front end.
pub fn front_end(polarity: Polarity) -> FrontEnd {
    let counts = |value| Estimate {
        value: Counts::from_int(value),
        u: Counts::from_int(4095),
    };
    FrontEnd {
        polarity,
        gain: Estimate {
            value: LARGEST_GAIN,
            u: LARGEST_GAIN,
        },
        read_noise: counts(32),
        saturation: Some(counts(4095)),
        black_level: counts(3960),
    }
}
