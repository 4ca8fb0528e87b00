//! Records of every kind: for tests of the record and of the store.

use crate::support::*;
use proptest::test_runner::RngSeed;
use slitrange::frame::comb::{CORRECTIONS, FEWEST};
use slitrange::row::front_end::{LARGEST_GAIN, LEAST_GAIN};

/// Thousands of cases, the same in every run.
pub fn cases(cases: u32) -> ProptestConfig {
    with(ProptestConfig::with_cases(cases), |it| {
        (it.rng_seed, it.failure_persistence) = (RngSeed::Fixed(6), None);
    })
}

pub fn nominal() -> Record {
    with(Record::nominal().expect("a record"), |it| {
        (it.serial_number, it.errors) = (4711, CalibrationErrors::Unknown);
        it.date = Date::new(2026, 11, 21).expect("a day");
        it.estimator = Estimator::PhaseTable;
        it.black_level = BlackLevel::Fixed(Counts::from_int(120));
    })
}

fn counts() -> impl Strategy<Value = Estimate<Counts>> {
    any_estimate(4095 << Counts::FRACTION).prop_map(|bits| estimate(bits.map(Counts::from_bits)))
}

/// A value and its uncertainty, in steps.
fn any_estimate(most: i32) -> impl Strategy<Value = [i32; 2]> {
    [0..=most, 0..=most]
}

prop_compose! {
    /// Front ends with any numbers that are within their ranges.
    pub fn front_ends()(
        polarity in prop::sample::select(vec![Polarity::Rising, Polarity::Falling]),
        [gain, u] in any_estimate(LARGEST_GAIN.to_bits()),
        read_noise in counts(),
        black_level in counts(),
        saturation in prop::option::of(counts()),
    ) -> FrontEnd {
        // One above black and noise, or none.
        let saturation = saturation.filter(|saturation| {
            let bits = [read_noise.value, black_level.value, saturation.value].map(Counts::to_bits);
            bits[2] - 4 * bits[0] > bits[1]
        });
        let gain = estimate([Electrons::from_bits(gain).max(LEAST_GAIN), Electrons::from_bits(u)]);
        FrontEnd { polarity, gain, read_noise, saturation, black_level }
    }
}

/// A correction of a slit, in steps.
const TERM: std::ops::RangeInclusive<i32> = -64 << 16..=64 << 16;

prop_compose! {
    /// Combs of 4 to 16 slits.
    fn combs()(
        places in prop::collection::btree_set(-16_384..=16_384, FEWEST..=MAX_SLITS),
        corrections in prop::collection::vec([TERM; CORRECTIONS], MAX_SLITS),
    ) -> Comb {
        let slit = |(place, bits): (i32, [i32; CORRECTIONS])| {
            SlitMap::nominal(place).corrected(bits.map(Pixels::from_bits))
        };
        let slits: Vec<SlitMap> = places.into_iter().zip(corrections).map(slit).collect();
        Comb::new(&slits).expect("ascending")
    }
}

pub fn longest() -> Record {
    let most = [Micrometres::MAX; PLACES];
    Record {
        serial_number: u32::MAX,
        date: Date::new(9999, 12, 31).expect("a day"),
        geometry: Geometry {
            words: 65_535,
            shielded: 65_000..65_535,
            light: 60_000..64_096,
            polarity: Polarity::Rising,
            bits: 12,
            shot_variance_per_count_q16: u16::MAX,
            saturation: slitrange::row::LARGEST_COUNT,
        },
        estimator: Estimator::GaussNewton,
        black_level: BlackLevel::Fixed(Counts::from_int(4095)),
        calibration: judges::longest::calibration(),
        errors: fitted(most, most, [Counts::MAX; PLACES]),
        profile: Some(Profile {
            first: Pixels::MAX,
            last: Pixels::MAX,
            width: [Pixels::MAX; PLACES],
            width_deviation: Pixels::MAX,
            components: [[Pixels::MAX; PLACES]; COMPONENTS],
            deviation: Pixels::MAX,
        }),
        comb: Some(judges::longest::comb()),
        front_end: Some(judges::longest::front_end(Polarity::Rising)),
    }
}

prop_compose! {
    fn geometries()(
        [start, shot] in any::<[u16; 2]>(),
        pixels in 3648..=4096usize,
        [shielded, more] in any::<[u8; 2]>(),
        falling in any::<bool>(),
        bits in 1..=12u8,
    ) -> Geometry {
        let start = usize::from(start) % 61_000;
        Geometry {
            words: start + pixels + usize::from(more),
            shielded: 0..usize::from(shielded),
            light: start..start + pixels,
            polarity: if falling { Polarity::Falling } else { Polarity::Rising },
            bits,
            shot_variance_per_count_q16: shot,
            saturation: slitrange::row::LARGEST_COUNT,
        }
    }
}

pub fn black_levels() -> impl Strategy<Value = BlackLevel> {
    let fixed = (0..=4095 << 8).prop_map(|bits| BlackLevel::Fixed(Counts::from_bits(bits)));
    prop_oneof![Just(BlackLevel::Shielded), Just(BlackLevel::Frame), fixed]
}

prop_compose! {
    pub fn records()(
        serial_number in any::<u32>(),
        (year, month, day) in any::<(u16, u8, u8)>(),
        geometry in geometries(),
        estimator in prop::sample::select(&Estimator::ALL[..]),
        black_level in black_levels(),
        calibration in calibrations(),
        errors in errors(),
        profile in prop::option::of(profiles()),
        comb in prop::option::of(combs()),
        front_end in prop::option::of(front_ends()),
    ) -> Option<Record> {
        let date = Date::new(year % 9999 + 1, month % 12 + 1, day % 28 + 1)?;
        let calibration = calibration?;
        Some(Record {
            serial_number, date, geometry, estimator, black_level, calibration, errors, profile, comb,
            front_end,
        })
    }
}

fn positive() -> impl Strategy<Value = i32> {
    0..=i32::MAX
}

prop_compose! {
    /// Spots of sensors. Some have a width of zero, which a record cannot hold.
    fn profiles()(
        ends in any::<[i32; 2]>(),
        width in any::<[u16; PLACES]>(),
        [width_deviation, deviation] in [positive(), positive()],
        components in any::<[[i32; PLACES]; COMPONENTS]>(),
    ) -> Profile {
        let [first, last] = ends.map(Pixels::from_bits);
        let [width_deviation, deviation] = [width_deviation, deviation].map(Pixels::from_bits);
        let width = width.map(|bits| Pixels::from_bits(bits.into()));
        let components = components.map(|values| values.map(Pixels::from_bits));
        Profile { first, last, width, width_deviation, components, deviation }
    }
}

prop_compose! {
    fn fitted_errors()(
        [curve, deviation] in any::<[[u32; PLACES]; 2]>(),
        height in any::<[u16; PLACES]>(),
        has_surface in any::<bool>(),
    ) -> CalibrationErrors {
        let length = |bits: u32| Micrometres::from_bits((bits >> 1).cast_signed());
        let (curve, deviation) = (curve.map(length), deviation.map(length));
        let height = height.map(|bits| Counts::from_bits(i32::from(bits) + 1));
        let surface = has_surface.then_some(FittedSurface { deviation, height });
        CalibrationErrors::Fitted(FittedErrors { curve, surface })
    }
}

fn errors() -> impl Strategy<Value = CalibrationErrors> {
    let others = vec![CalibrationErrors::Unknown, CalibrationErrors::Nominal];
    prop_oneof![1 => prop::sample::select(others), 2 => fitted_errors()]
}

fn rises() -> impl Strategy<Value = Vec<(u32, i64)>> {
    prop::collection::vec((0..1u32 << 21, 1i64 << 10..1 << 18), 1..120)
}

prop_compose! {
    fn tables()(start in (0..1 << 24i32, any::<i32>()), steps in rises(), falls in any::<bool>())
        -> Option<Calibration> {
        let rise = |_, rise: i64| if falls { -rise } else { rise };
        Some(Calibration::Table(Table::new(&chain(start, &steps, rise)).ok()?))
    }
}

prop_compose! {
    /// K from 1 m at a thousand pixels down, on either side of a pole.
    fn curves()(
        d in any::<i32>(),
        k in 1i64 << 40..1 << 46,
        [falls, below] in any::<[bool; 2]>(),
        from_pole in 1..4000i32,
    ) -> Option<Eq1> {
        let pole = if below { -from_pole } else { 3647 + from_pole };
        let range = Pixels::from_int(0)..=Pixels::from_int(3647);
        let k = if falls { k } else { -k };
        Eq1::new(Micrometres::from_bits(d), k, Pixels::from_int(pole), range).ok()
    }
}

prop_compose! {
    fn corrected_curves()(
        curve in curves(),
        (centre, value) in (0..1 << 24i32, any::<i32>()),
        steps in rises(),
        shift in 0..12u32,
    ) -> Option<Calibration> {
        let rise = |_, rise: i64| (rise - (1 << 17)) >> shift;
        let knots = chain((centre, value >> 12), &steps, rise);
        Some(Calibration::Corrected(Corrected::new(curve?, &knots).ok()?))
    }
}

/// Calibrations over centres of 3648 pixels.
fn calibrations() -> impl Strategy<Value = Option<Calibration>> {
    let alone = curves().prop_map(|curve| curve.map(Calibration::Eq1));
    prop_oneof![alone, tables(), corrected_curves()]
}

/// Knots from a start, each a step beyond the last; `rise` makes the rise of a step from its length and its
/// number. The chain ends where a number would overflow.
pub fn chain(start: (i32, i32), steps: &[(u32, i64)], rise: impl Fn(u32, i64) -> i64) -> Vec<Knot> {
    let (mut centre, mut value) = (i64::from(start.0), i64::from(start.1));
    let mut knots = Vec::new();
    let mut steps = steps.iter();
    while let (Ok(x), Ok(y)) = (i32::try_from(centre), i32::try_from(value)) {
        knots.push(Knot {
            centre: Pixels::from_bits(x),
            value: Micrometres::from_bits(y),
        });
        let Some(&(length, step)) = steps.next() else {
            break;
        };
        let length = length.saturating_add(CLOSEST.to_bits() as u32);
        centre += i64::from(length);
        value += rise(length, step);
    }
    knots
}
