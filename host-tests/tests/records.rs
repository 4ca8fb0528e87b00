//! Records of every kind: for tests of the record and of the store.

use crate::support::*;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use slitrange::frame::comb::{CORRECTIONS, FEWEST, LARGEST_CORRECTION};
use slitrange::row::front_end::{LARGEST_GAIN, LEAST_GAIN};

/// Thousands of cases, the same in every run.
pub fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: RngSeed::Fixed(6),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

pub fn nominal() -> Record {
    Record {
        serial_number: 4711,
        date: Date::new(2026, 11, 21).expect("a day"),
        geometry: sensor_heads::tcd1304dg(),
        estimator: Estimator::PhaseTable,
        black_level: BlackLevel::Fixed(Counts::from_int(120)),
        calibration: Calibration::nominal().expect("a curve"),
        profile: None,
        errors: CalibrationErrors::Unknown,
        comb: None,
        front_end: None,
    }
}

/// A comb whose numbers take all bytes that they can.
fn widest_comb() -> Comb {
    let most = Pixels::from_int(LARGEST_CORRECTION);
    // 8193 um and more take four bytes.
    let places = (0..8).map(|i| i - 16_384).chain((0..8).map(|i| i + 8_193));
    let slits: Vec<SlitMap> = places
        .map(|place| SlitMap::nominal(place).corrected([most; CORRECTIONS]))
        .collect();
    Comb::new(&slits).expect("ascending")
}

/// A front end whose numbers take all bytes that they can.
fn widest_front_end() -> FrontEnd {
    let counts = |value| Estimate {
        value: Counts::from_int(value),
        u: Counts::from_int(4095),
    };
    FrontEnd {
        polarity: Polarity::Rising,
        gain: Estimate {
            value: LARGEST_GAIN,
            u: LARGEST_GAIN,
        },
        read_noise: counts(32),
        saturation: Some(counts(4095)),
        black_level: counts(3960),
    }
}

/// Front ends with any numbers that are within their ranges.
pub fn front_ends() -> impl Strategy<Value = FrontEnd> {
    let bits = |most: i32| (0..=most, 0..=most);
    let counts = move || {
        bits(4095 << Counts::FRACTION).prop_map(|(value, u)| Estimate {
            value: Counts::from_bits(value),
            u: Counts::from_bits(u),
        })
    };
    let gain = bits(LARGEST_GAIN.to_bits()).prop_map(|(value, u)| Estimate {
        value: Electrons::from_bits(value).max(LEAST_GAIN),
        u: Electrons::from_bits(u),
    });
    let levels = (counts(), prop::option::of(counts()));
    let polarity = prop::sample::select(vec![Polarity::Rising, Polarity::Falling]);
    (polarity, gain, counts(), levels).prop_map(
        |(polarity, gain, read_noise, (black_level, saturation))| FrontEnd {
            polarity,
            gain,
            read_noise,
            // One above black and noise, or none.
            saturation: saturation.filter(|saturation| {
                let bits =
                    [read_noise.value, black_level.value, saturation.value].map(Counts::to_bits);
                bits[2] - 4 * bits[0] > bits[1]
            }),
            black_level,
        },
    )
}

/// Combs of 4 to 16 slits.
fn combs() -> impl Strategy<Value = Comb> {
    let term = || (-64 << 16..=64 << 16).prop_map(Pixels::from_bits);
    let corrections = prop::collection::vec([(); CORRECTIONS].map(|()| term()), MAX_SLITS);
    (
        prop::collection::btree_set(-16_384..=16_384, FEWEST..=MAX_SLITS),
        corrections,
    )
        .prop_map(|(places, corrections)| {
            let slits = places.into_iter().zip(corrections);
            let slits: Vec<SlitMap> = slits
                .map(|(place, correction)| SlitMap::nominal(place).corrected(correction))
                .collect();
            Comb::new(&slits).expect("ascending")
        })
}

/// The longest record that there can be.
pub fn longest() -> Record {
    // Centres beyond 2048 pixels, values beyond 0.52 m and a K of 55 bits take all bytes that theirs can.
    let at = |i: i32| Knot {
        centre: Pixels::from_bits((2048 << 16) + i * 800_000),
        value: Micrometres::from_int(2_000_000 + i),
    };
    let knots: Vec<Knot> = (0..MAX_KNOTS as i32).map(at).collect();
    let curve = Eq1::new(
        Micrometres::from_int(-7_000_000),
        1 << 54,
        Pixels::from_int(-32_768),
        knots[0].centre..=knots[MAX_KNOTS - 1].centre,
    )
    .expect("7.9 m to 7.6 m, less 7 m");
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
        calibration: Calibration::Corrected(Corrected::new(curve, &knots).expect("usable")),
        errors: CalibrationErrors::Fitted(FittedErrors {
            curve: [Micrometres::MAX; PLACES],
            surface: Some(FittedSurface {
                deviation: [Micrometres::MAX; PLACES],
                height: [Counts::MAX; PLACES],
            }),
        }),
        profile: Some(Profile {
            first: Pixels::MAX,
            last: Pixels::MAX,
            width: [Pixels::MAX; PLACES],
            width_deviation: Pixels::MAX,
            components: [[Pixels::MAX; PLACES]; COMPONENTS],
            deviation: Pixels::MAX,
        }),
        comb: Some(widest_comb()),
        front_end: Some(widest_front_end()),
    }
}

/// Records of every kind, most of them usable.
pub fn records() -> impl Strategy<Value = Option<Record>> {
    let estimators = prop::sample::select(Estimator::ALL.to_vec());
    let black_levels = prop_oneof![
        Just(BlackLevel::Shielded),
        Just(BlackLevel::Frame),
        (0..=4095 << 8).prop_map(|bits| BlackLevel::Fixed(Counts::from_bits(bits))),
    ];
    let geometries = (
        any::<[u16; 2]>(),
        3648..=4096usize,
        any::<[u8; 2]>(),
        any::<bool>(),
        1..=12u8,
    )
        .prop_map(|([start, shot], pixels, [shielded, more], falling, bits)| {
            let light = usize::from(start) % 61_000..usize::from(start) % 61_000 + pixels;
            Geometry {
                words: light.end + usize::from(more),
                shielded: 0..usize::from(shielded),
                light,
                polarity: if falling {
                    Polarity::Falling
                } else {
                    Polarity::Rising
                },
                bits,
                shot_variance_per_count_q16: shot,
                saturation: slitrange::row::LARGEST_COUNT,
            }
        });
    let days = (any::<u16>(), any::<u8>(), any::<u8>())
        .prop_map(|(year, month, day)| Date::new(year % 9999 + 1, month % 12 + 1, day % 28 + 1));
    (
        any::<u32>(),
        days,
        geometries,
        estimators,
        black_levels,
        calibrations(),
        errors(),
        prop::option::of(profiles()),
        (prop::option::of(combs()), prop::option::of(front_ends())),
    )
        .prop_map(
            |(
                serial_number,
                date,
                geometry,
                estimator,
                black_level,
                calibration,
                errors,
                profile,
                (comb, front_end),
            )| {
                Some(Record {
                    serial_number,
                    date: date?,
                    geometry,
                    estimator,
                    black_level,
                    calibration: calibration?,
                    profile,
                    errors,
                    comb,
                    front_end,
                })
            },
        )
}

/// Spots of sensors. Some have a width of zero, which a record cannot hold.
fn profiles() -> impl Strategy<Value = Profile> {
    let positive = || (0..1u32 << 31).prop_map(|bits| Pixels::from_bits(bits.cast_signed()));
    let widths = any::<[u16; PLACES]>();
    let components = any::<[[i32; PLACES]; COMPONENTS]>();
    (
        any::<[i32; 2]>(),
        widths,
        positive(),
        components,
        positive(),
    )
        .prop_map(
            |([first, last], width, width_deviation, components, deviation)| Profile {
                first: Pixels::from_bits(first),
                last: Pixels::from_bits(last),
                width: width.map(|bits| Pixels::from_bits(bits.into())),
                width_deviation,
                components: components.map(|values| values.map(Pixels::from_bits)),
                deviation,
            },
        )
}

/// Errors of every kind.
fn errors() -> impl Strategy<Value = CalibrationErrors> {
    let positive = |bits: u32| (bits >> 1).cast_signed();
    let lengths = move || {
        any::<[u32; PLACES]>()
            .prop_map(move |bits| bits.map(|bits| Micrometres::from_bits(positive(bits))))
    };
    let heights = any::<[u16; PLACES]>()
        .prop_map(|bits| bits.map(|bits| Counts::from_bits(i32::from(bits) + 1)));
    let surface =
        (lengths(), heights).prop_map(|(deviation, height)| FittedSurface { deviation, height });
    let fitted = (lengths(), prop::option::of(surface))
        .prop_map(|(curve, surface)| CalibrationErrors::Fitted(FittedErrors { curve, surface }));
    prop_oneof![
        1 => Just(CalibrationErrors::Unknown),
        1 => Just(CalibrationErrors::Nominal),
        4 => fitted
    ]
}

/// Calibrations over centres of 3648 pixels.
fn calibrations() -> impl Strategy<Value = Option<Calibration>> {
    let steps = || prop::collection::vec((0..1u32 << 21, 1i64 << 10..1 << 18), 1..120);
    let start = || (0..1 << 24i32, any::<i32>());
    let table = (start(), steps(), any::<bool>()).prop_map(|(start, steps, falls)| {
        let rise = |_, rise: i64| if falls { -rise } else { rise };
        Table::new(&chain(start, &steps, rise))
            .ok()
            .map(Calibration::Table)
    });
    // K from 1 m at a thousand pixels down, on either side of a pole.
    let curve = || {
        (
            any::<i32>(),
            1i64 << 40..1 << 46,
            any::<bool>(),
            1..4000i32,
            any::<bool>(),
        )
            .prop_map(|(d, k, falls, from_pole, below)| {
                let pole = if below { -from_pole } else { 3647 + from_pole };
                let k = if falls { k } else { -k };
                let range = Pixels::from_int(0)..=Pixels::from_int(3647);
                Eq1::new(Micrometres::from_bits(d), k, Pixels::from_int(pole), range)
            })
    };
    let corrected =
        (curve(), start(), steps(), 0..12u32).prop_map(|(curve, start, steps, shift)| {
            let rise = |_, rise: i64| (rise - (1 << 17)) >> shift;
            let knots = chain((start.0, start.1 >> 12), &steps, rise);
            Corrected::new(curve.ok()?, &knots)
                .ok()
                .map(Calibration::Corrected)
        });
    prop_oneof![
        curve().prop_map(|curve| curve.ok().map(Calibration::Eq1)),
        table,
        corrected
    ]
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
