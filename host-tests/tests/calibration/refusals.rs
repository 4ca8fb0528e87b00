//! Invalid calibrations are refused, and the error says what is wrong.

use crate::records::cases;
use crate::support::*;
use slitrange::distance::knots::KnotsError;
use slitrange::distance::table::TableError;

#[test]
fn the_error_of_an_invalid_table_names_the_wrong_knot() {
    let wrong = |knots: &[Knot]| Table::new(knots).err();
    let good = [knot(0, 900_000), knot(10, 890_000), knot(2000, 500_000)];
    let few = |knots| Some(TableError::Knots(KnotsError::TooFew { knots }));
    let order = |index, centre| Some(TableError::Knots(KnotsError::Order { index, centre }));
    let not_monotone = |index, um| {
        let distance = Micrometres::from_int(um);
        Some(TableError::NotMonotone { index, distance })
    };
    // A sixteenth of a pixel.
    assert_eq!(16 * CLOSEST.to_bits(), Pixels::from_int(1).to_bits());
    let closer = Pixels::from_bits(CLOSEST.to_bits() - 1);
    let second = |centre| Knot { centre, ..good[1] };
    let with_third = |um| [good[0], good[1], knot(20, um), good[2]];
    for (knots, error) in [
        (&good[..], None),
        (&good[..0], few(0)),
        (&good[..1], few(1)),
        (&[good[1], good[0], good[2]], order(1, Pixels::from_int(0))),
        (&[good[0], good[1], good[1]], order(2, Pixels::from_int(10))),
        (&[good[0], second(closer)], order(1, closer)),
        (&[good[0], second(CLOSEST)], None),
        (&with_third(890_100), not_monotone(2, 890_100)),
        (&with_third(890_000), not_monotone(2, 890_000)),
        (&[knot(0, 5), knot(1, 5)], not_monotone(1, 5)),
        // A sixteenth of a micrometre a pixel is just enough.
        (&[knot(0, 0), knot(160, 10)], None),
        (&[knot(0, 0), knot(160, -10)], None),
        (&[knot(0, 0), knot(161, 10)], not_monotone(1, 10)),
    ] {
        assert_eq!(wrong(knots), error, "{knots:?}");
    }
    // 2^22 um, and a step less, over all the centres that there are.
    let far = |value| {
        let first = with(knot(0, 0), |it| it.centre = Pixels::MIN);
        let last = with(first, |it| (it.centre, it.value) = (Pixels::MAX, value));
        wrong(&[first, last])
    };
    let value = Micrometres::from_int(1 << 22);
    let step = KnotsError::Step { index: 1, value };
    assert_eq!(far(value), Some(TableError::Knots(step)));
    assert_eq!(far(Micrometres::from_bits(value.to_bits() - 1)), None);

    let knots: Vec<Knot> = (0..=MAX_KNOTS as i32).map(|i| knot(i, -i)).collect();
    assert_eq!(wrong(&knots[..MAX_KNOTS]), None);
    let too_many = KnotsError::TooMany { knots: knots.len() };
    assert_eq!(wrong(&knots), Some(TableError::Knots(too_many)));
}

#[test]
fn the_error_of_invalid_residuals_names_the_wrong_knot() {
    let nominal = NOMINAL.expect("a curve");
    let wrong = |knots: &[Knot]| Corrected::new(nominal.clone(), knots).err();
    let beyond = |index, x| {
        let centre = Pixels::from_int(x);
        Some(CorrectedError::Beyond { index, centre })
    };
    let few = CorrectedError::Knots(KnotsError::TooFew { knots: 1 });
    let centre = Pixels::from_int(1191);
    let far = Some(CorrectedError::Distance { centre });
    let good = [knot(1191, 50), knot(2654, -50)];

    for (knots, error) in [
        (&good[..], None),
        (&[knot(1191, 50)], Some(few)),
        (&[knot(1190, 50), knot(2654, -50)], beyond(0, 1190)),
        (&[good[0], good[1], knot(2655, 0)], beyond(2, 2655)),
        (&[1191, 2654].map(|centre| knot(centre, 8_000_000)), far),
    ] {
        assert_eq!(wrong(knots), error, "{knots:?}");
    }
    // At pixel 2600 the curve falls by about 245 um a pixel.
    let centre = Pixels::from_int(2601);
    let (_, slope) = nominal.distance_at(centre).expect("in range");
    let half = (-0.5 * slope) as i32;
    println!("slope {slope} um a pixel");
    for sign in [1, -1] {
        // Two knots: the cubic is a straight line.
        let knots = |rise: i32| [knot(2600, 0), knot(2601, sign * rise)];
        assert_eq!(wrong(&knots(half)), None);
        let steep = CorrectedError::Steep { index: 1, centre };
        assert_eq!(wrong(&knots(half + 1)), Some(steep));
    }
}

#[test]
fn errors_say_what_is_wrong_and_what_to_do() {
    let (index, centre) = (7, Pixels::from_f32(12.5));
    let value = Micrometres::MIN;
    let distance = Micrometres::from_int(900_000);
    let errors: [&dyn std::fmt::Display; 8] = [
        &TableError::Knots(KnotsError::TooFew { knots: 1 }),
        &TableError::Knots(KnotsError::TooMany { knots: 300 }),
        &TableError::Knots(KnotsError::Order { index, centre }),
        &TableError::Knots(KnotsError::Step { index, value }),
        &TableError::NotMonotone { index, distance },
        &CorrectedError::Beyond { index, centre },
        &CorrectedError::Steep { index, centre },
        &CorrectedError::Distance { centre },
    ];
    let text = errors.map(|error| format!("{error}\n")).concat();
    insta::assert_snapshot!(text);
}

proptest! {
    #![proptest_config(cases(4000))]

    /// The reason in the error is true, and the constructor never panics.
    #[test]
    fn any_knots_are_a_table_or_an_error(
        knots in prop::collection::vec(any::<(i32, i32)>(), 0..6),
    ) {
        let knots: Vec<Knot> = knots
            .iter()
            .map(|&(x, y)| Knot { centre: Pixels::from_bits(x), value: Micrometres::from_bits(y) })
            .collect();
        let sorted = knots.windows(2).all(|k| k[0].centre < k[1].centre);
        let rises = knots.windows(2).all(|k| k[0].value < k[1].value);
        let falls = knots.windows(2).all(|k| k[0].value > k[1].value);
        match Table::new(&knots) {
            Ok(_) => prop_assert!(knots.len() >= 2 && sorted && (rises || falls)),
            Err(TableError::Knots(KnotsError::TooFew { .. })) => prop_assert!(knots.len() < 2),
            Err(TableError::Knots(KnotsError::TooMany { .. })) => prop_assert!(false),
            Err(TableError::Knots(KnotsError::Order { index, centre })) => {
                prop_assert_eq!(knots[index].centre, centre);
                prop_assert!(centre.to_f64() < knots[index - 1].centre.to_f64() + CLOSEST.to_f64());
            }
            Err(TableError::Knots(KnotsError::Step { index, value })) => {
                prop_assert_eq!(knots[index].value, value);
                let step = value.to_f64() - knots[index - 1].value.to_f64();
                prop_assert!(step.abs() >= 2f64.powi(22));
            }
            Err(TableError::NotMonotone { index, distance }) => {
                prop_assert_eq!(knots[index].value, distance);
                let before = knots[index - 1];
                let rise = distance.to_f64() - before.value.to_f64();
                let length = knots[index].centre.to_f64() - before.centre.to_f64();
                let flat = rise.abs() < length / 16.0;
                let falls = knots[knots.len() - 1].value < knots[0].value;
                prop_assert!(flat || (rise < 0.0) != falls);
            }
        }
    }
}
