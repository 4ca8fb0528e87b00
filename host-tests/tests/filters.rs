//! The steps between a frame's reading and its line: what a filter claims of its distance is what its
//! distances show.

use crate::support::*;
use slitrange_device::filters::average::{Average, Filter};
use slitrange_device::filters::{Limits, SpikeFilter, Spikes};

/// A reading at a distance, whose parts are all 3 um but for the noise.
fn reading(distance: Micrometres, noise: Micrometres) -> Reading {
    let parts = with(parts([Micrometres::from_int(3); 7]), |it| it.noise = noise);
    let errors = CalibrationErrors::Nominal;
    let reading = nominal_reading(&at_centre(1800.0), &errors, Surface::Auto);
    with(reading.expect("a distance"), |it| {
        (it.distance, it.uncertainty, it.parts) = (distance, parts.combined(), parts);
    })
}

const FAULT: Fault = Fault::NoSpot {
    amplitude: Counts::from_int(5),
};

/// The scatter of the filter's distances over many runs, against the repeatability that it claims: at the
/// start, with a full window, and long after. The median claims its limit for many readings, pi/2: the
/// variance is 0.76 of the claimed one for four readings (order statistics of a gaussian: 0.298 against
/// 0.393), and nearer for all other numbers. The parts that readings share stay.
#[test]
fn the_repeatability_of_a_filter_is_its_scatter() {
    const RUNS: usize = 4000;
    const NOISE_UM: f64 = 5.0;
    let noise = Micrometres::from_f32(NOISE_UM as f32);
    let template = reading(Micrometres::from_int(800_000), noise);
    for (average, least) in [
        (Average::Moving(2), 1.0),
        (Average::Moving(8), 1.0),
        (Average::Moving(64), 1.0),
        (Average::Median(4), 0.87),
        (Average::Median(9), 0.87),
        (Average::Recursive(2), 1.0),
        (Average::Recursive(8), 1.0),
    ] {
        let (Average::Moving(n) | Average::Median(n) | Average::Recursive(n)) = average else {
            continue;
        };
        let ends = [1, 2, 3, usize::from(n), 3 * usize::from(n)];
        let mut squares = [0.0; 5];
        let mut claimed = [0.0; 5];
        for run in 0..RUNS {
            let mut random = random(run as u64);
            let mut filter = Filter::default();
            for count in 1..=3 * usize::from(n) {
                let error: f64 = StandardNormal.sample(&mut random);
                let distance = Micrometres::from_f32(800_000.0 + (NOISE_UM * error) as f32);
                let now = with(template, |it| it.distance = distance);
                let out = filter.take(average, false, Ok(now)).expect("a distance");
                for (place, _) in ends.iter().enumerate().filter(|(_, end)| **end == count) {
                    squares[place] += (out.distance.to_f64() - 800_000.0).powi(2);
                    claimed[place] = out.parts.noise.to_f64();
                }
                let expected = with(template.parts, |it| it.noise = out.parts.noise);
                assert_eq!(out.parts, expected);
                assert_eq!(out.uncertainty, expected.combined());
            }
        }
        let scatter = squares.map(|it: f64| (it / RUNS as f64).sqrt());
        for ((end, scatter), claimed) in ends.iter().zip(scatter).zip(claimed) {
            let share = scatter / claimed;
            print!("{average:?} after {end}: ");
            println!("scatter {scatter:.3} um of {claimed:.3}, {share:.3}");
            // Four standard deviations of a scatter over so many runs.
            let chance = 4.0 / (2.0 * RUNS as f64).sqrt();
            assert!((least - chance..1.0 + chance).contains(&share));
        }
        let variances = (claimed[4] / NOISE_UM).powi(2);
        let n = f64::from(n);
        let expected = match average {
            Average::Moving(_) | Average::None => 1.0 / n,
            Average::Median(_) => std::f64::consts::FRAC_PI_2 / n,
            Average::Recursive(_) => {
                // The mean of N readings, forgotten by (1 - 1/N)^2 a reading.
                let last = 1.0 / (2.0 * n - 1.0);
                last + (1.0 / n - last) * (1.0 - 1.0 / n).powf(4.0 * n)
            }
        };
        let off = (variances / expected - 1.0).abs();
        assert!(off < 0.01, "{average:?}: {variances} {expected}");
    }
}

/// With `ambient subtract` the noise of the dark rows is shared by all rows: a mean claims sqrt(2) times as
/// much, and one reading its own.
#[test]
fn noise_of_dark_rows_shrinks_less() {
    let now = reading(Micrometres::from_int(800_000), Micrometres::from_int(8));
    let mut filter = Filter::default();
    let mut noise = || {
        let out = filter.take(Average::Moving(4), true, Ok(now));
        out.expect("a distance").parts.noise.to_f32()
    };
    let found = [(); 4].map(|()| noise());
    println!("{found:?}");
    let expected = [1.0, 1.0, f32::sqrt(2.0 / 3.0), f32::sqrt(0.5)].map(|it| 8.0 * it);
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 0.005, "{found} {expected}");
    }
}

/// Flags of a reading stay until it leaves the window, and N faults empty the window.
#[test]
fn a_filter_shows_the_flags_of_its_window_and_forgets_over_faults() {
    let near = reading(Micrometres::from_int(700_000), Micrometres::from_int(8));
    let near = with(near, |it| (it.misfits, it.correlated) = (3, Some(4)));
    let far = reading(Micrometres::from_int(900_000), Micrometres::from_int(8));
    for average in [Average::Moving, Average::Median, Average::Recursive] {
        let average = average(3);
        let mut filter = Filter::default();
        let mut take = |result| filter.take(average, false, result);
        take(Ok(near)).expect("a distance");
        for _ in 0..2 {
            let out = take(Ok(far)).expect("a distance");
            assert_eq!((out.misfits, out.correlated), (3, Some(4)), "{average:?}");
        }
        let out = take(Ok(far)).expect("a distance");
        // The recursive mean still has a share of the flagged reading.
        let flags = match average {
            Average::Recursive(_) => (3, Some(4)),
            _ => (0, None),
        };
        assert_eq!((out.misfits, out.correlated), flags, "{average:?}");
        assert_eq!(take(Err(FAULT)), Err(FAULT));
        let out = take(Ok(near)).expect("a distance");
        assert!(out.distance > near.distance, "{average:?}: {out:?}");
        for _ in 0..3 {
            assert_eq!(take(Err(FAULT)), Err(FAULT));
        }
        assert_eq!(take(Ok(near)), Ok(near), "{average:?}");
    }
}

/// A recursive mean's flag stays until its readings have less than 1 % of the weight and leave the window.
#[test]
fn a_recursive_filter_shows_a_flag_while_its_readings_have_weight() {
    let plain = reading(Micrometres::from_int(700_000), Micrometres::from_int(8));
    let flagged = with(plain, |it| (it.misfits, it.correlated) = (3, Some(4)));
    for n in [2u8, 8, 21, 22, 64] {
        for flagged_ones in [1, 5 * u32::from(n)] {
            let mut filter = Filter::default();
            let mut take = |now| {
                let out = filter.take(Average::Recursive(n), false, Ok(now));
                let out = out.expect("a distance");
                (out.misfits, out.correlated)
            };
            // A full mean, in which each reading has the weight 1/N at first.
            for _ in 0..n {
                assert_eq!(take(plain), (0, None));
            }
            for _ in 0..flagged_ones {
                assert_eq!(take(flagged), (3, Some(4)));
            }
            let n = f64::from(n);
            let kept = 1.0 - 1.0 / n;
            let weight = 1.0 - kept.powi(flagged_ones as i32);
            let least = (0.01 / weight).ln() / kept.ln();
            // The window holds the last flagged reading for N - 1 more results.
            let results = (least.floor() as u32).max(n as u32 - 1);
            for after in 1..=results {
                assert_eq!(take(plain), (3, Some(4)), "{n}: {after} of {results}");
            }
            assert_eq!(take(plain), (0, None), "{n}: after {results}");
            println!("recursive {n}: {flagged_ones} flagged, then {results} results with the flag");
        }
    }
}

fn averages() -> impl Strategy<Value = Average> {
    let kinds = vec![Average::Moving, Average::Median, Average::Recursive];
    let averages = (prop::sample::select(kinds), 2u8..=64).prop_map(|(kind, n)| kind(n));
    prop_oneof![1 => Just(Average::None), 3 => averages]
}

proptest! {
    /// A fault stays a fault, a distance lies among those that came, and its noise is not above the largest.
    #[test]
    fn a_filter_invents_nothing(
        average in averages(),
        is_ambient_subtracted: bool,
        results in prop::collection::vec(prop::option::weighted(0.8, (any::<i32>(), 1..1 << 30)), 1..150),
    ) {
        let mut filter = Filter::default();
        let (mut nearest, mut farthest, mut noisiest) = (i32::MAX, i32::MIN, 0);
        for result in results {
            let reading = result.map(|(distance, noise)| {
                (nearest, farthest) = (nearest.min(distance), farthest.max(distance));
                noisiest = noisiest.max(noise);
                reading(Micrometres::from_bits(distance), Micrometres::from_bits(noise))
            });
            let out = filter.take(average, is_ambient_subtracted, reading.ok_or(FAULT));
            match (reading, out) {
                (None, out) => prop_assert_eq!(out, Err(FAULT)),
                (Some(_), Err(fault)) => prop_assert!(false, "{fault}"),
                (Some(_), Ok(out)) => {
                    let distance = out.distance.to_bits();
                    prop_assert!((nearest..=farthest).contains(&distance), "{}", distance);
                    // A float has 24 bits.
                    let noise = f64::from(out.parts.noise.to_bits());
                    prop_assert!(noise >= 1.0 && noise <= f64::from(noisiest) * (1.0 + 1e-5));
                    prop_assert!(out.uncertainty >= out.parts.noise || out.parts.noise.to_bits() > 1 << 24);
                }
            }
        }
    }
}

/// Limits as the setting allows them, and near the ends of what a distance can be.
fn limits() -> impl Strategy<Value = (i32, i32, i32)> {
    let most = Limits::MOST_UM as i32 * 256;
    let most_hysteresis = Limits::MOST_HYSTERESIS_UM as i32 * 256;
    (-most..=most, -most..=most, 0..=most_hysteresis)
        .prop_map(|(one, other, hysteresis)| (one.min(other), one.max(other), hysteresis))
}

proptest! {
    /// The output switches on only with a distance within the limits, and off only with one beyond the
    /// hysteresis or without a distance. Whatever comes between the two, it does not switch.
    #[test]
    fn the_output_never_switches_within_the_hysteresis(
        (low, high, hysteresis) in limits(),
        distances in prop::collection::vec(prop::option::weighted(0.9, any::<i32>()), 1..50),
        near in prop::collection::vec(any::<u32>(), 1..50),
    ) {
        let um = Micrometres::from_bits;
        let limits = Limits::Within { low: um(low), high: um(high), hysteresis: um(hysteresis) };
        let mut is_on = false;
        let mut switch = |distance: Option<i32>| {
            let was_on = is_on;
            is_on = limits.is_on(was_on, distance.map(um));
            (was_on, is_on)
        };
        // As i64, in which nothing saturates.
        let [low, high, hysteresis] = [low, high, hysteresis].map(i64::from);
        let band = low - hysteresis..=high + hysteresis;
        for distance in distances {
            let at = distance.map(i64::from);
            let is_within = at.is_some_and(|at| (low..=high).contains(&at));
            let is_in_band = at.is_some_and(|at| band.contains(&at));
            let (was_on, is_on) = switch(distance);
            prop_assert_eq!(is_on, is_within || was_on && is_in_band);
        }
        // In the band it switches at most once: on.
        let width = (band.end() - band.start() + 1) as u64;
        let mut switched = 0;
        for part in near {
            let distance = band.start() + (u64::from(part) % width) as i64;
            let distance = distance.clamp(i32::MIN.into(), i32::MAX.into()) as i32;
            let (was_on, is_on) = switch(Some(distance));
            prop_assert!(is_on || !was_on);
            switched += u32::from(is_on != was_on);
        }
        prop_assert!(switched <= 1);
    }
}

proptest! {
    /// Of any results: a fault stays as it is, and a reading as it is or a spike. A good reading is farther
    /// than the filter's distance from the last good one only if the two results before were withheld, and
    /// agree with it and with each other. Three readings in succession that agree end with a good one.
    #[test]
    fn a_spike_filter_lets_a_jump_pass_only_when_three_readings_agree(
        most in prop_oneof![Just(1u32), 1..=SpikeFilter::MOST_UM, Just(SpikeFilter::MOST_UM)],
        // In eighths of the filter's distance, so that many agree and many do not.
        places in prop::collection::vec(prop::option::weighted(0.85, -24..24i32), 1..200),
    ) {
        let most = most as i32 * 256;
        let filter = SpikeFilter::Beyond(Micrometres::from_bits(most));
        let agree = |one: i32, other: i32| one.abs_diff(other) <= most.unsigned_abs();
        let mut spikes = Spikes::default();
        let mut good: Option<i32> = None;
        // The results before: the distance, and whether it was good.
        let mut before: Vec<Option<(i32, bool)>> = vec![];
        for place in places {
            let distance = place.map(|place| place * (most / 8).max(1));
            let noise = Micrometres::from_int(8);
            let result = distance.map(|bits| reading(Micrometres::from_bits(bits), noise)).ok_or(FAULT);
            let out = spikes.take(filter, result);
            let Some(now) = distance else {
                prop_assert_eq!(out, Err(FAULT));
                before.push(None);
                continue;
            };
            let two = match before[..] {
                [.., Some(older), Some(newer)] => Some([older, newer]),
                _ => None,
            };
            match out {
                Ok(out) => {
                    prop_assert_eq!(Ok(out), result);
                    if good.is_some_and(|good| !agree(good, now)) {
                        let [older, newer] = two.expect("two readings before a jump");
                        prop_assert!(!older.1 && !newer.1);
                        prop_assert!(agree(older.0, newer.0) && agree(older.0, now) && agree(newer.0, now));
                    }
                    good = Some(now);
                }
                Err(fault) => {
                    let good = good.expect("the first reading is good");
                    let step = Micrometres::from_bits((now - good).abs());
                    prop_assert_eq!(fault, Fault::Spike { step });
                    prop_assert!(!agree(good, now));
                    let agreed = two.is_some_and(|[older, newer]| {
                        agree(older.0, newer.0) && agree(older.0, now) && agree(newer.0, now)
                    });
                    prop_assert!(!agreed);
                }
            }
            before.push(Some((now, out.is_ok())));
        }
    }
}

/// Distances at both ends of the range are not taken for near ones.
#[test]
fn the_farthest_jump_is_a_spike() {
    let noise = Micrometres::from_int(8);
    let [first, last] = [Micrometres::MIN, Micrometres::MAX].map(|it| reading(it, noise));
    let filter = SpikeFilter::Beyond(Micrometres::from_int(SpikeFilter::MOST_UM as i32));
    let mut spikes = Spikes::default();
    let step = Micrometres::MAX;
    assert_eq!(spikes.take(filter, Ok(first)), Ok(first));
    assert_eq!(spikes.take(filter, Ok(last)), Err(Fault::Spike { step }));
    // Without the filter nothing is withheld, and nothing is remembered.
    assert_eq!(spikes.take(SpikeFilter::Off, Ok(last)), Ok(last));
    assert_eq!(spikes.take(filter, Ok(first)), Ok(first));
}
