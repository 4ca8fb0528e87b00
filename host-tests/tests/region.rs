//! The settings `region` and `peak`: which part of a row is searched, and which of several spots is measured.

use crate::support::*;
use slitrange::spot::choice::SpotChoice;

const PIXELS: usize = 3648;

#[derive(Clone, Copy, Debug)]
struct Light(f64, f64, f64);

/// A row with these spots, in shot noise and read noise.
fn row(random: &mut ChaCha8Rng, spots: &[Light]) -> Vec<u16> {
    let of = |pixel: f64, it: &Light| it.2 * gaussian(pixel - it.0, it.1);
    noisy_row(random, PIXELS as u16, |pixel| {
        spots.iter().map(|it| of(pixel, it)).sum()
    })
}

fn measure(options: Options, rows: &[Vec<u16>]) -> Result<Measured, Fault> {
    frames::measure_rows(rows, &geometry(PIXELS, 6554), options, None)
}

#[test]
fn a_region_is_measured_as_a_row_of_these_pixels() {
    let mut random = random(1);
    let (mut centres, mut faults) = (0, 0);
    for number in 0..400 {
        let first = random.random_range(0..3000);
        let last = random.random_range(first + 100..PIXELS as u16);
        let inside = random.random_range(f64::from(first)..f64::from(last));
        let spot = |centre, random: &mut ChaCha8Rng| {
            let width = random.random_range(1.2..20.0);
            let height = 10.0 * f64::powf(400.0, random.random_range(0.0..1.0));
            Light(centre, width, height)
        };
        let mut spots = vec![spot(inside, &mut random)];
        if number % 3 == 0 {
            let anywhere = random.random_range(0.0..PIXELS as f64);
            spots.push(spot(anywhere, &mut random));
        }
        let rows: Vec<_> = (0..3).map(|_| row(&mut random, &spots)).collect();
        let narrow = with(geometry(PIXELS, 6554), |it| {
            it.light = first.into()..usize::from(last) + 1
        });
        let whole = options(|it| it.estimator = Estimator::ALL[number % Estimator::ALL.len()]);
        let region = Region::new(first, last).expect("a region");
        let narrowed = with(whole, |it| it.region = region);
        let in_region = measure(narrowed, &rows);
        let on_row = |place: Pixels| Pixels::from_bits(place.to_bits() + (i32::from(first) << 16));
        let of_row = frames::measure_rows(&rows, &narrow, whole, None);
        match (in_region, of_row) {
            (Ok(found), Ok(expected)) => {
                centres += 1;
                let centre = on_row(expected.frame.centre);
                assert_eq!(found.frame.centre, centre, "{spots:?}");
                assert_eq!(found.frame.uncertainty, expected.frame.uncertainty);
                assert_eq!(found.frame.misfits, expected.frame.misfits);
            }
            (Err(found), Err(expected)) => {
                faults += 1;
                let mut moved = expected;
                if let Fault::SpotAtEdge { centre } = &mut moved {
                    *centre = on_row(*centre);
                }
                if let Fault::TwoSpots { centre, other } = &mut moved {
                    (*centre, *other) = (on_row(*centre), on_row(*other));
                }
                assert_eq!(found, moved, "{spots:?}");
            }
            (found, expected) => panic!("{found:?} {expected:?} {spots:?}"),
        }
    }
    println!("{centres} centres, {faults} faults");
    assert!(centres > 200 && faults > 20);
}

/// Two or three spots of any heights, of which the lowest is a fifth of the highest or more. `first` and
/// `last` measure theirs within the claimed uncertainty.
#[test]
fn peak_measures_the_first_or_the_last_spot() {
    let mut random = random(4);
    for peak in [SpotChoice::First, SpotChoice::Last] {
        let (mut squares, mut number, mut faults, mut flagged) = (0.0, 0, 0, 0);
        for _ in 0..1000 {
            let width = random.random_range(3.0..12.0);
            let mut centre = random.random_range(300.0..800.0);
            let spots = (0..random.random_range(2..=3)).map(|_| {
                let spot = Light(centre, width, random.random_range(500.0..2500.0));
                centre += random.random_range(40.0..100.0) * width;
                spot
            });
            let spots: Vec<_> = spots.filter(|it| it.0 < 3400.0).collect();
            let rows: Vec<_> = (0..2).map(|_| row(&mut random, &spots)).collect();
            let wanted = match peak {
                SpotChoice::Last => spots.last(),
                _ => spots.first(),
            };
            match measure(options(|it| it.peak = peak), &rows) {
                Ok(found) if found.frame.misfits > 0 => flagged += 1,
                Ok(found) => {
                    let error = found.frame.centre.to_f64() - wanted.expect("a spot").0;
                    let in_u = error / found.frame.uncertainty.to_f64();
                    assert!(in_u.abs() < 5.0, "{error} px, {in_u} u, {spots:?}");
                    squares += in_u * in_u;
                    number += 1;
                }
                Err(_) => faults += 1,
            }
        }
        let rms = (squares / f64::from(number)).sqrt();
        let name = peak.name();
        println!("{name}: {number} centres, {rms:.3} u, {flagged} flagged, {faults} faults");
        assert!(number > 980 && (0.95..1.05).contains(&rms));
    }
}

/// One spot is measured as without the setting: to the same bits.
#[test]
fn one_spot_is_the_first_and_the_last() {
    let mut random = random(5);
    for _ in 0..300 {
        let centre = random.random_range(0.0..PIXELS as f64);
        let width = random.random_range(1.2..25.0);
        let spot = Light(centre, width, random.random_range(20.0..3500.0));
        let rows = [row(&mut random, &[spot]), row(&mut random, &[spot])];
        let strongest = measure(Options::default(), &rows);
        assert!(!matches!(strongest, Err(Fault::SensorSilent)), "{spot:?}");
        for peak in [SpotChoice::First, SpotChoice::Last] {
            let found = measure(options(|it| it.peak = peak), &rows);
            let [found, strongest] = [&found, &strongest].map(|it| format!("{it:?}"));
            assert_eq!(found, strongest, "{} {spot:?}", peak.name());
        }
    }
}

/// Spots that are too close to be parted: the answer is one of them, a fault or a flag. Two that look like
/// one spot are measured as without the setting.
#[test]
fn close_spots_give_no_confident_error() {
    let mut random = random(6);
    let (mut centres, mut rest, mut wrong) = (0, 0, 0);
    for _ in 0..2000 {
        let width = random.random_range(3.0..12.0);
        let centre = random.random_range(800.0..2500.0);
        let first = Light(centre, width, random.random_range(300.0..2500.0));
        let centre = centre + width * random.random_range(2.0..40.0);
        let second = Light(centre, width, random.random_range(300.0..2500.0));
        let rows = [row(&mut random, &[first, second])];
        let peak = [SpotChoice::First, SpotChoice::Last][centres % 2];
        match measure(options(|it| it.peak = peak), &rows) {
            Ok(found) if found.frame.misfits == 0 => {
                centres += 1;
                let u = (found.frame.uncertainty.to_f64()).hypot(found.by_shape.to_f64());
                let error = |spot: &Light| (found.frame.centre.to_f64() - spot.0).abs();
                if error(&first).min(error(&second)) > 5.0 * u {
                    wrong += 1;
                    // They look like one spot.
                    let strongest = measure(Options::default(), &rows);
                    let found = format!("{:?}", Ok::<_, Fault>(found));
                    assert_eq!(found, format!("{strongest:?}"));
                }
            }
            _ => rest += 1,
        }
    }
    println!("{centres} centres, {rest} faults and flags, {wrong} beyond 5 u of both");
    assert!(wrong <= 2 && centres > 500 && rest > 100);
}
