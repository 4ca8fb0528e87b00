//! What must not change a row's centre, and how the centre must follow a change of the row, for every
//! estimator. proptest draws the rows around a spot, the same rows in every run.

use crate::support::*;
use proptest::test_runner::{RngAlgorithm, TestCaseError, TestRng, TestRunner};
use std::cell::RefCell;

/// A spot on a row of [`PIXELS`], and what else is on it.
#[derive(Clone, Copy, Debug)]
struct Drawn {
    cell: Cell,
    centre: f64,
    flaw: Flaw,
}

/// What a sensor adds to a spot. Places are in widths from the centre.
#[derive(Clone, Copy, Debug)]
enum Flaw {
    None,
    /// A pixel with so many counts more.
    Hot(f64, u16),
    Dead(f64),
    /// A second spot of so much of the height.
    Second(f64, f64),
    /// A background that rises by so many counts a pixel, from what it is without at its dark end.
    Tilt(f64),
}

fn logarithmic(from: f64, to: f64) -> impl Strategy<Value = f64> {
    (from.ln()..to.ln()).prop_map(f64::exp)
}

fn flaws() -> impl Strategy<Value = Flaw> {
    prop_oneof![
        4 => Just(Flaw::None),
        1 => (-8.0..8.0, 20..1000u16).prop_map(|(at, counts)| Flaw::Hot(at, counts)),
        1 => (-3.0..3.0).prop_map(Flaw::Dead),
        1 => (2.0..15.0, 0.02..0.6).prop_map(|(at, share)| Flaw::Second(at, share)),
        1 => (-0.1..0.1).prop_map(Flaw::Tilt),
    ]
}

prop_compose! {
    /// Widths of 0.6 to 100 pixels in the middle of a row, from lost in the noise to nearly full scale.
    fn drawn()(
        width in logarithmic(0.6, 100.0),
        amplitude in logarithmic(20.0, 3000.0),
        read_noise in logarithmic(0.5, 40.0),
        shot in prop_oneof![Just(None), (2.0..20.0).prop_map(Some)],
        seed in any::<u64>(),
        from_middle in -100.0..100.0,
        flaw in flaws(),
    ) -> Drawn {
        let cell = cell(width, amplitude, (read_noise, shot), 0, seed);
        Drawn { cell, centre: PIXELS as f64 / 2.0 + from_middle, flaw }
    }
}

impl Drawn {
    fn is_clean(&self) -> bool {
        matches!(self.flaw, Flaw::None)
    }

    /// Twenty times the noise and more: the search finds its width to a factor of two.
    fn is_bright(&self) -> bool {
        self.cell.amplitude > 20.0 * self.cell.read_noise
    }

    fn geometry(&self) -> Geometry {
        self.cell.scene_of(PIXELS).geometry()
    }

    /// The row's counts, at most `most`.
    fn light(&self, most: u16) -> Vec<u16> {
        let scene = self.cell.scene_of(PIXELS);
        let mut light = scene.row_with_centre(0, self.centre, 1.0);
        let place = |at: f64| (self.centre + at * self.cell.width).round() as usize;
        match self.flaw {
            Flaw::None => {}
            Flaw::Hot(at, counts) => light[place(at)] += f32::from(counts),
            Flaw::Dead(at) => light[place(at)] = 0.0,
            Flaw::Second(at, share) => {
                let (width, height) = (self.cell.width, share * self.cell.amplitude);
                for (i, count) in light.iter_mut().enumerate() {
                    let offset = i as f64 - self.centre - at * width;
                    *count += (height * phase_tables::gaussian(offset, width)) as f32;
                }
            }
            Flaw::Tilt(slope) => {
                let dark_end = if slope > 0.0 { 0.0 } else { PIXELS as f64 };
                for (i, count) in light.iter_mut().enumerate() {
                    *count += (slope * (i as f64 - dark_end)) as f32;
                }
            }
        }
        quantise(&light, most)
    }
}

/// Runs a property on as many draws, the same in every run.
fn holds<T: std::fmt::Debug>(
    cases: u32,
    strategy: impl Strategy<Value = T>,
    property: impl Fn(T) -> Result<(), TestCaseError>,
) {
    let config = with(ProptestConfig::with_cases(cases), |it| {
        it.failure_persistence = None
    });
    let random = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    let outcome = TestRunner::new_with_rng(config, random).run(&strategy, property);
    outcome.unwrap_or_else(|error| panic!("{error}"));
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Way {
    Alone,
    /// With the look that follows it.
    Pipeline,
}

const WAYS: [Way; 2] = [Way::Alone, Way::Pipeline];

/// The way in which an estimator's figures go on from row to row. The check of the centroid repairs a centre
/// that does not look right, which for the centroid is often and makes a step.
fn steady(estimator: Estimator) -> Way {
    match estimator {
        Estimator::Centroid => Way::Alone,
        _ => Way::Pipeline,
    }
}

fn find_centre(way: Way, estimator: Estimator, light: &[u16], geometry: &Geometry) -> Answer {
    centre_at(way, estimator, light, &find(light)?, geometry)
}

/// Finds the centre of a spot that [`find`] found.
fn centre_at(
    way: Way,
    estimator: Estimator,
    light: &[u16],
    (spot, budget): &(Spot, WorkBudget),
    geometry: &Geometry,
) -> Answer {
    let row = Row::new(light, &[], geometry.saturated_from()).expect("12 bits");
    match way {
        Way::Alone => centre::centre(estimator, &row, spot, None, geometry),
        Way::Pipeline => centre_of_spot(estimator, &row, spot, None, geometry, None, *budget),
    }
}

fn find(light: &[u16]) -> Result<(Spot, WorkBudget), Fault> {
    spot::find(&Row::new(light, &[], 4095).expect("12 bits"))
}

#[derive(Default)]
struct Spreads(RefCell<[Vec<f64>; Estimator::ALL.len()]>);

impl Spreads {
    fn add(&self, estimator: Estimator, value: f64) {
        self.0.borrow_mut()[estimator as usize].push(value);
    }

    /// More values than this are added, and their root mean square and the largest are at most that.
    #[track_caller]
    fn assert(&self, by: Estimator, what: &str, (count, most, worst): (usize, f64, f64)) {
        let off = &self.0.borrow()[by as usize];
        let (n, rms, largest) = (off.len(), rms(off), judges::accuracy::largest(off));
        println!("{by:?}: {what} {rms:.4} rms, {largest:.4} at most, of {n}");
        assert!(n > count && rms <= most && largest <= worst, "{by:?}");
    }
}

/// A constant on all pixels, none clipped, changes no bit of a centre, nor of a fault without counts.
#[test]
fn the_black_level_changes_no_bit() {
    const CASES: u32 = 1000;
    let found = RefCell::new(0);
    holds(CASES, (drawn(), 1..2100u16), |(drawn, offset)| {
        let geometry = drawn.geometry();
        let light = drawn.light(4094 - offset);
        let raised: Vec<u16> = light.iter().map(|count| count + offset).collect();
        for (estimator, way) in pairs(Estimator::ALL, WAYS) {
            let of = |light: &[u16]| find_centre(way, estimator, light, &geometry);
            let (dark, bright) = (of(&light), of(&raised));
            prop_assert_eq!(dark, bright, "{:?} {:?}", estimator, way);
            *found.borrow_mut() += u32::from(dark.is_ok());
        }
        Ok(())
    });
    let (found, all) = (found.into_inner(), CASES * 2 * Estimator::ALL.len() as u32);
    println!("{found} of {all} are centres, and none of them changes");
    assert!(found > all / 2, "{found}");
}

/// The row `pixels` further on: what leaves it at the end enters at its start.
fn turned(light: &[u16], pixels: usize) -> Vec<u16> {
    let (stays, leaves) = light.split_at(light.len() - pixels);
    [leaves, stays].concat()
}

/// The spot is shifted by any number of whole pixels, and the estimator starts from the shifted pixel. Then
/// the centre is shifted by the same number, and every other bit stays. The reason: the windows move with the
/// spot by whole pixels, and f32 sees only places within a window.
#[test]
fn a_shifted_spot_has_the_shifted_centre() {
    let found = RefCell::new(0);
    holds(2000, (drawn(), 1..100usize), |(drawn, pixels)| {
        let geometry = drawn.geometry();
        let light = drawn.light(4095);
        // A tilt leaves a step where the row's ends meet, and that may be what is found.
        let spot = match find(&light) {
            Ok(found) if (found.0.centre as f64 - drawn.centre).abs() < 100.0 => found,
            _ => return Ok(()),
        };
        let shifted = turned(&light, pixels);
        let there = with(spot, |it| it.0.centre += pixels);
        for (estimator, way) in pairs(Estimator::ALL, WAYS) {
            let here = centre_at(way, estimator, &light, &spot, &geometry);
            let there = centre_at(way, estimator, &shifted, &there, &geometry);
            match (here, there) {
                (Ok(here), Ok(there)) => {
                    let there = shifted_back(there, pixels);
                    // Of the pairs of a wide spot the check leaves out those that an end of the row cuts.
                    let reach = 6.2 * here.width.to_f64() + 7.0;
                    let last = light.len() as f64 - 1.0 - pixels as f64;
                    if !(reach..=last - reach).contains(&here.centre.to_f64()) {
                        continue;
                    }
                    prop_assert_eq!(here, there, "{:?} {:?}", estimator, way);
                    *found.borrow_mut() += 1;
                }
                // Of the widest windows some reach over one of the edges, the one or the other.
                (Err(Fault::SpotAtEdge { .. }), Err(_))
                | (Err(_), Err(Fault::SpotAtEdge { .. })) => {}
                (Err(here), Err(there)) => {
                    prop_assert_eq!(here.kind(), there.kind(), "{:?} {:?}", estimator, way)
                }
                _ => prop_assert!(false, "{estimator:?} {way:?}: {here:?}, {there:?}"),
            }
        }
        Ok(())
    });
    let found = found.into_inner();
    println!("{found} centres move by whole pixels and in no other bit");
    assert!(found > 10_000);
}

fn shifted_back(centre: RowCentre, pixels: usize) -> RowCentre {
    let bits = centre.centre.to_bits() - Pixels::from_int(pixels as i32).to_bits();
    with(centre, |it| it.centre = Pixels::from_bits(bits))
}

/// Here the coarse search starts anew in the shifted row. If the shift is a multiple of the search's largest
/// block, the centre is shifted exactly. For other shifts, the search may give another pixel or another width
/// to start from, and it measures the noise on other pixels. So the estimator may use another table or
/// window. On clean rows this moves the centre by a tenth of its uncertainty root mean square, and by twice
/// its uncertainty at most. A tenth adds half a per cent to an error.
///
/// `fraunhofer` depends more on the table: its tables are for a slit's pattern, and the spot is a gaussian.
#[test]
fn a_shifted_row_has_the_shifted_centre() {
    let (spreads, whole) = (Spreads::default(), RefCell::new(0));
    let shifts = prop_oneof![(1..300usize), (1..4usize).prop_map(|blocks| 128 * blocks)];
    holds(4000, (drawn(), shifts), |(drawn, pixels)| {
        // Shifted by up to three blocks, all windows stay on the row.
        let drawn = with(drawn, |it| it.centre -= 190.0);
        if !drawn.is_clean() {
            return Ok(());
        }
        let geometry = drawn.geometry();
        let light = drawn.light(4095);
        let shifted = turned(&light, pixels);
        for estimator in Estimator::ALL {
            let of = |light: &[u16]| find_centre(steady(estimator), estimator, light, &geometry);
            let (Ok(here), Ok(there)) = (of(&light), of(&shifted)) else {
                continue;
            };
            let there = shifted_back(there, pixels);
            if pixels % 128 == 0 {
                // A wide spot has fewer pairs in one of the places.
                let here = with(here, |it| it.shape = there.shape);
                prop_assert_eq!(here, there, "{:?}", estimator);
                *whole.borrow_mut() += 1;
            } else if drawn.is_bright() {
                let off = there.centre.to_f64() - here.centre.to_f64();
                spreads.add(estimator, off / here.uncertainty.to_f64());
            }
        }
        Ok(())
    });
    let whole = whole.into_inner();
    println!("{whole} centres move by 128 pixels or a multiple, and in no other bit; the others:");
    assert!(whole > 4000, "{whole}");
    for estimator in Estimator::ALL {
        let is_slit = estimator == Estimator::Fraunhofer;
        let limits = (150, if is_slit { 0.15 } else { 0.1 }, 2.0);
        spreads.assert(estimator, "of the uncertainty", limits);
    }
}

/// The mirrored row has the mirrored centre: no estimator prefers a side.
///
/// For the centroid this is exact, except for the rounding of sums in another order. The other estimators may
/// use a window that is half a sample or a phase away, and such a window sees other noise. Two unbiased
/// estimates with errors of k times the bound differ by at most 2 sqrt(1 - 1/k^2) of their uncertainty root
/// mean square: by 0.8 for the phase tables (k = 1.09). A tenth is asserted: half a per cent of an error.
///
/// In one of a hundred rows the check makes a second fit, perhaps in the mirrored row only. `fraunhofer` may
/// differ by several uncertainties, because its tables are for the pattern of a slit: two neighbouring tables
/// find different centres for a gaussian. All estimators do so with spots narrower than their tables.
#[test]
fn a_mirrored_spot_has_the_mirrored_centre() {
    let spreads = Spreads::default();
    holds(2000, drawn(), |drawn| {
        if !(drawn.is_clean() && drawn.is_bright() && drawn.cell.width >= NARROWEST) {
            return Ok(());
        }
        let geometry = drawn.geometry();
        let light = drawn.light(4095);
        let turned = mirrored(&light);
        let Ok(spot) = find(&light) else {
            return Ok(());
        };
        let there = with(spot, |it| it.0.centre = PIXELS - 1 - it.0.centre);
        for estimator in Estimator::ALL {
            let way = steady(estimator);
            let here = centre_at(way, estimator, &light, &spot, &geometry);
            let there = centre_at(way, estimator, &turned, &there, &geometry);
            if let (Ok(here), Ok(there)) = (here, there) {
                let off = here.centre.to_f64() + there.centre.to_f64() - (PIXELS - 1) as f64;
                let unit = match estimator {
                    Estimator::Centroid => 1.0 / STEPS,
                    _ => here.uncertainty.to_f64(),
                };
                spreads.add(estimator, off / unit);
            }
        }
        Ok(())
    });
    for estimator in Estimator::ALL {
        let (unit, worst) = match estimator {
            Estimator::Centroid => ("steps of 2^-16 pixel", 1.0),
            Estimator::Fraunhofer => ("of the uncertainty", 5.0),
            _ => ("of the uncertainty", 2.0),
        };
        spreads.assert(estimator, unit, (100, 0.1, worst));
    }
}

/// The narrowest width in pixels that there is a table for.
const NARROWEST: f64 = 0.79;
/// Steps of a centre in a pixel.
const STEPS: f64 = 65536.0;

/// Doubles the counts above the lowest count, and the variance of the shot noise in a count. The centre and
/// its uncertainty stay the same.
///
/// Sums and ratios stay the same to the bit, because doubling is exact in a float. There are exceptions.
/// Blocks of 16 pixels are halved, which cuts off half a count of a sample. A half maximum is rounded to 2^-8
/// count. The level beside a spot on a slope is known to 1/16 count, so these rows have no tilt. The noise is
/// measured to 2^-8 count, with an error of one and a half steps after all roundings. Such a difference may
/// change the choice of tables or of outliers. The centre then moves by a small part of its uncertainty.
#[test]
fn twice_the_light_gives_the_same_centre_and_uncertainty() {
    let (steps, parts, claims) = (Spreads::default(), Spreads::default(), Spreads::default());
    let others = Spreads::default();
    holds(2000, drawn(), |drawn| {
        if matches!(drawn.flaw, Flaw::Tilt(_)) {
            return Ok(());
        }
        let geometry = drawn.geometry();
        let light = drawn.light(2000);
        let least = light.iter().min().copied().unwrap_or_default();
        let single: Vec<u16> = light.iter().map(|count| count - least).collect();
        let double: Vec<u16> = single.iter().map(|count| 2 * count).collect();
        let (Ok(one), Ok(two)) = (find(&single), find(&double)) else {
            return Ok(());
        };
        let noise = f64::from(one.0.background.noise.to_bits());
        // 1/sqrt(12) of a count, which is 74/256, is the least noise that there is.
        if noise <= 74.0 {
            return Ok(());
        }
        let shot = 2 * geometry.shot_variance_per_count_q16;
        let brighter = with(geometry.clone(), |it| it.shot_variance_per_count_q16 = shot);
        for estimator in Estimator::ALL {
            let here = centre_at(Way::Alone, estimator, &single, &one, &geometry);
            let there = centre_at(Way::Alone, estimator, &double, &two, &brighter);
            let (Ok(here), Ok(there)) = (here, there) else {
                continue;
            };
            let off = there.centre.to_f64() - here.centre.to_f64();
            let claim = here.uncertainty.to_f64();
            let blocks = [one.0.block_log2, two.0.block_log2];
            if drawn.is_clean() {
                // The search has heights in 1/16 counts: of two scales that are nearly alike it may take the
                // one or the other.
                let is_alike = blocks[0] == blocks[1];
                let of = if is_alike { &parts } else { &others };
                of.add(estimator, off / claim);
            }
            // From this width on a look is at samples of 16 pixels, maybe the first one only.
            if blocks.iter().any(|it| *it >= 7)
                || blocks[0] != blocks[1]
                || here.class.block.max(there.class.block) == 16
            {
                continue;
            }
            steps.add(estimator, off * STEPS);
            let rounding = 1.5 / noise + 1.0 / (claim * STEPS);
            let other = (there.uncertainty.to_f64() / claim - 1.0).abs();
            claims.add(estimator, (other - rounding).max(0.0));
        }
        Ok(())
    });
    for estimator in Estimator::ALL {
        let most_steps = match estimator {
            Estimator::Adaptive | Estimator::GaussNewton => f64::INFINITY,
            _ => 0.0,
        };
        let of_steps = (500, f64::INFINITY, most_steps);
        steps.assert(estimator, "steps of 2^-16 pixel", of_steps);
        parts.assert(estimator, "of the uncertainty", (500, 0.05, 1.0));
        let at_other_scale = "of the uncertainty, at another scale";
        others.assert(estimator, at_other_scale, (0, f64::INFINITY, 2.0));
        claims.assert(estimator, "uncertainty", (0, f64::INFINITY, 0.05));
    }
}

/// The same noise under up to four times the height: the claim does not grow, and no centre is lost.
///
/// This holds too if the brighter spot uses another table. The limit of 5 % has two reasons. The flanks of a
/// wide spot look like a little noise, and the claim of the centroid depends on the width at half maximum.
/// Together they change the claim by 5 % in one of some thousand rows.
#[test]
fn more_light_never_raises_the_uncertainty() {
    let growth = Spreads::default();
    holds(3000, (drawn(), logarithmic(1.0, 4.0)), |(drawn, factor)| {
        let amplitude = drawn.cell.amplitude * factor;
        if !(drawn.is_clean() && drawn.is_bright()) || amplitude > 3000.0 {
            return Ok(());
        }
        // The claim has the shot noise that the rows do not: it would not be the same.
        let geometry = drawn.geometry();
        let of = |amplitude: f64| {
            let mut drawn = drawn;
            (drawn.cell.amplitude, drawn.cell.electrons_per_count) = (amplitude, None);
            drawn.light(4095)
        };
        let (dim, bright) = (of(drawn.cell.amplitude), of(amplitude));
        for estimator in Estimator::ALL {
            let of = |light: &[u16]| find_centre(steady(estimator), estimator, light, &geometry);
            let Ok(dim) = of(&dim) else {
                continue;
            };
            match of(&bright) {
                Ok(bright) => {
                    let more = bright.uncertainty.to_f64() / dim.uncertainty.to_f64() - 1.0;
                    growth.add(estimator, more.max(0.0));
                }
                Err(fault) => prop_assert!(false, "{:?}: {:?} became {:?}", estimator, dim, fault),
            }
        }
        Ok(())
    });
    for estimator in Estimator::ALL {
        growth.assert(estimator, "grows by", (100, f64::INFINITY, 0.05));
    }
}
