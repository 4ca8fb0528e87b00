//! The error budget of a scene: how far the core's centres lie from the truth, and how much of that each
//! effect is to blame for.
//!
//! What an effect is to blame for is found by leaving it out: its share is 1 - (RMS error without it)^2 /
//! (RMS error)^2, of the readings that have a centre with it and without it. Effects that add independent
//! errors have shares that add up to one; others have not, and an effect without which the error would be
//! larger has a negative one.
//!
//! Some effects change from row to row (noise), others stay for as long as the target does (speckle, texture)
//! or the sensor (fixed pattern, response). One row in many draws of the latter says as much as many rows of
//! one draw do of the former, so readings are taken of many realisations of the scene: each has another seed,
//! and the target up to half a pixel nearer or farther, and gives a few readings that lie apart in time. With
//! an effect and without, all else is the same, down to the noise.

use slitrange::centre;
use slitrange::spot;

use simulator::scene::{Effect, Sensor};

use crate::prelude::*;

/// Seconds in which a sensor warms up.
const WARM_UP: f64 = 600.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Scenes that differ in their seed and in the sub-pixel place of the spot.
    pub realisations: u64,
    /// Readings of each: a row of a line sensor, a frame of a camera.
    pub readings: u64,
    /// Time over which a realisation's readings are spread, in seconds.
    pub seconds: f64,
}

impl Plan {
    /// 400 rows, or 24 frames, over ten minutes, in which a sensor warms up; or over as much of them as it
    /// takes the target to move by a centimetre.
    pub fn of(scene: &Scene) -> Self {
        let (realisations, readings) = match scene.sensor {
            // Each realisation of speckle takes a tenth of a second.
            Sensor::Tcd1304dg | Sensor::Row(_) if scene.speckle.is_some() => (40, 10),
            Sensor::Tcd1304dg | Sensor::Row(_) => (100, 4),
            Sensor::Camera => (24, 1),
        };
        let seconds = match &scene.motion {
            Some(motion) => (0.01 / motion.speed.abs()).min(WARM_UP),
            None => WARM_UP,
        };
        Self {
            realisations,
            readings,
            seconds,
        }
    }

    /// Fails if the plan takes the target to where the scene cannot be simulated.
    pub fn check(&self, scene: &Scene) -> Result<()> {
        if let Some(motion) = &scene.motion {
            let last = motion.distance(scene.distance, self.seconds);
            scene.check_distance(last).with_context(|| {
                let (speed, seconds) = (motion.speed, self.seconds);
                format!("a target that moves by {speed} m/s for {seconds} s: take fewer seconds")
            })?;
        }
        Ok(())
    }
}

/// How far readings lie from the truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Errors {
    /// Root mean square in pixels; none where no reading has a centre.
    pub rms_px: Option<f64>,
    pub mean_px: Option<f64>,
    /// Root mean square of the distance by eq. (1), in micrometres.
    pub rms_um: Option<f64>,
    /// Mean of the distance, in micrometres.
    pub mean_um: Option<f64>,
    pub readings: u64,
    /// How many of them have no centre, by the fault's name. Of a frame, that of most of its rows.
    pub faults: Vec<(&'static str, u64)>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Without {
    pub effect: Effect,
    /// The error then; none where the scene's other effects need this one.
    pub errors: Option<Errors>,
    pub share: Option<Share>,
}

/// 1 - (RMS error without)^2 / (RMS error)^2, of the readings that have a centre with the effect and without
/// it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share {
    pub value: f64,
    /// Its standard uncertainty, by the jackknife over the realisations; none of a single one.
    pub uncertainty: Option<f64>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Budget {
    pub plan: Plan,
    pub whole: Errors,
    pub without: Vec<Without>,
}

impl Budget {
    /// How many realisations it takes: those of the scene, and of the scene without each effect that can be
    /// left out.
    pub fn runs(scene: &Scene, plan: &Plan) -> u64 {
        let without = effects(scene).filter(|&effect| without(scene, effect).is_some());
        (1 + without.count() as u64) * plan.realisations
    }

    /// Runs the core over the scene, and over the scene without each of its effects in turn. `ran` is called
    /// after each of [`Budget::runs`].
    pub fn of(
        scene: &Scene,
        estimator: Estimator,
        plan: &Plan,
        ran: &(dyn Fn() + Sync),
    ) -> Result<Self> {
        plan.check(scene)?;
        // The core is told the same of its sensor throughout: without its shot noise too.
        let geometry = scene.geometry();
        let effects: Vec<Effect> = effects(scene).collect();
        let mut scenes = vec![scene.clone()];
        scenes.extend(effects.iter().filter_map(|&effect| without(scene, effect)));
        let jobs: Vec<(usize, u64)> = (0..scenes.len())
            .flat_map(|scene| (0..plan.realisations).map(move |k| (scene, k)))
            .collect();
        // In order, so that sums are the same on any number of threads.
        let found: Vec<Vec<Found>> = jobs
            .into_par_iter()
            .map(|(scene, k)| {
                let found = realisation(&scenes[scene], &geometry, estimator, plan, k);
                ran();
                found
            })
            .collect();
        let mut variants = found.chunks(plan.realisations as usize);
        let whole = variants.next().context("no scene was run")?;
        let without = effects
            .into_iter()
            .map(|effect| {
                let found = without(scene, effect).and_then(|_| variants.next());
                Without {
                    effect,
                    errors: found.map(errors),
                    share: found.and_then(|found| share(whole, found)),
                }
            })
            .collect();
        Ok(Self {
            plan: *plan,
            whole: errors(whole),
            without,
        })
    }
}

pub fn effects(scene: &Scene) -> impl Iterator<Item = Effect> {
    (Effect::ALL.into_iter()).filter(|&effect| scene.lists(effect))
}

/// The scene without an effect, where that is a scene: some effects need others.
pub fn without(scene: &Scene, effect: Effect) -> Option<Scene> {
    let without = scene.clone().without(effect);
    without.check().is_ok().then_some(without)
}

/// What came of a reading: errors in pixels and micrometres, or why there is none.
type Found = Result<(f64, f64), Fault>;

fn realisation(
    scene: &Scene,
    geometry: &Geometry,
    estimator: Estimator,
    plan: &Plan,
    k: u64,
) -> Vec<Found> {
    // Additive recurrence with the golden ratio and with the square root of 2: even over pixel and time.
    let even = |step: f64| (k as f64 * step + 0.5).fract();
    let optics = &scene.optics;
    let phase = even(0.618_033_988_749_895) - 0.5;
    let distance = optics.distance(optics.centre(scene.distance) + phase);
    let seed = scene.seed.wrapping_add(k);
    let simulation = Simulation::new(with(scene.clone(), |it| it.seed = seed));
    (0..plan.readings)
        .map(|reading| {
            let share = (reading as f64 + even(std::f64::consts::SQRT_2)) / plan.readings as f64;
            let period = (share * plan.seconds / scene.period()) as u64;
            let first = period * scene.sensor.rows();
            let centre = mean_centre(&simulation, geometry, estimator, first, distance)?;
            let truth = simulation.true_distance(first, distance);
            Ok((
                centre - simulation.true_centre(first, distance),
                (optics.distance(centre) - truth) * 1e6,
            ))
        })
        .collect()
}

/// Rows of a frame count that are at least this share of the highest one's height: what a lens's flare lights
/// is no spot.
const HIGH: f64 = 0.1;

/// The centre of a row in pixels; of a frame the mean over its rows, as in the paper.
fn mean_centre(
    simulation: &Simulation,
    geometry: &Geometry,
    estimator: Estimator,
    first: u64,
    distance: f64,
) -> Result<f64, Fault> {
    let scene = simulation.scene();
    let mut centres = vec![];
    let mut faults: [(u32, Option<Fault>); Fault::KINDS] = Default::default();
    for row in first..first + scene.sensor.rows() {
        let counts = simulation.row(row, distance, scene.exposure);
        let counts = quantise(&counts, geometry.full_scale());
        match row_centre(&counts, geometry, estimator) {
            Ok(centre) => centres.push((centre.centre.to_f64(), centre.amplitude.to_f64())),
            Err(fault) => {
                let (count, latest) = &mut faults[fault.kind()];
                *count += 1;
                *latest = Some(fault);
            }
        }
    }
    let highest = (centres.iter()).fold(0.0f64, |highest, (_, height)| highest.max(*height));
    centres.retain(|(_, height)| *height >= HIGH * highest);
    if !centres.is_empty() {
        let sum: f64 = centres.iter().map(|(centre, _)| centre).sum();
        return Ok(sum / centres.len() as f64);
    }
    let most = faults.into_iter().max_by_key(|(count, _)| *count);
    Err(most.and_then(|it| it.1).unwrap_or(Fault::SensorSilent))
}

/// The core's centre of a row of counts, light positive, of which nothing is known from rows before.
pub fn row_centre(
    counts: &[u16],
    geometry: &Geometry,
    estimator: Estimator,
) -> Result<RowCentre, Fault> {
    let light = &counts[geometry.light.clone()];
    let shielded = &counts[geometry.shielded.clone()];
    let row =
        Row::new(light, shielded, geometry.saturated_from()).map_err(|_| Fault::SensorSilent)?;
    centre::centre(estimator, &row, &spot::find(&row)?.0, None, geometry)
}

fn errors(realisations: &[Vec<Found>]) -> Errors {
    let found = || realisations.iter().flatten();
    let good: Vec<(f64, f64)> = found().filter_map(|found| found.ok()).collect();
    let mean = |value: &dyn Fn(&(f64, f64)) -> f64| {
        (!good.is_empty()).then(|| statistics::mean(good.iter().map(value)))
    };
    let of_kind = |kind| {
        let faults = found().filter(|it| matches!(it, Err(fault) if fault.kind() == kind));
        faults.count() as u64
    };
    Errors {
        rms_px: mean(&|(px, _)| px * px).map(f64::sqrt),
        mean_px: mean(&|(px, _)| *px),
        rms_um: mean(&|(_, um)| um * um).map(f64::sqrt),
        mean_um: mean(&|(_, um)| *um),
        readings: found().count() as u64,
        faults: (Fault::NAMES.into_iter().enumerate())
            .map(|(kind, name)| (name, of_kind(kind)))
            .filter(|(_, count)| *count > 0)
            .collect(),
    }
}

/// The share of the squares, in pixels, of the readings that have a centre with the effect and without it:
/// those that one of them makes faults of would tell which rows are left, and not what became of them. None
/// where there are no such readings.
fn share(whole: &[Vec<Found>], without: &[Vec<Found>]) -> Option<Share> {
    // Of each realisation the sums of squares with and without.
    let sums: Vec<(f64, f64)> = (whole.iter().zip(without))
        .map(|(whole, without)| {
            let both = whole.iter().zip(without).filter_map(|pair| match pair {
                (Ok((whole, _)), Ok((without, _))) => Some((whole * whole, without * without)),
                _ => None,
            });
            both.fold((0.0, 0.0), |sum, pair| (sum.0 + pair.0, sum.1 + pair.1))
        })
        .collect();
    let total = (sums.iter()).fold((0.0, 0.0), |sum, pair| (sum.0 + pair.0, sum.1 + pair.1));
    let share = |left_out: Option<usize>| {
        let (whole, without) = left_out.map_or((0.0, 0.0), |k| sums[k]);
        1.0 - (total.1 - without) / (total.0 - whole)
    };
    let value: f64 = share(None);
    let n = sums.len();
    let left_out: Vec<f64> = (0..n).map(|k| share(Some(k))).collect();
    let middle = statistics::mean(&left_out);
    let squares: f64 = left_out.iter().map(|value| (value - middle).powi(2)).sum();
    value.is_finite().then(|| Share {
        value,
        uncertainty: (n > 1).then(|| (squares * (n as f64 - 1.0) / n as f64).sqrt()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use simulator::bound;
    use simulator::scene::{Motion, Quantisation, ReadNoise, SecondReflection, Temperature};

    /// Of `phase-table`: its weights do not follow the noise, so they fit as well if a noise is left out.
    fn budget(scene: &Scene) -> Budget {
        budget_of(scene, Estimator::PhaseTable)
    }

    fn budget_of(scene: &Scene, estimator: Estimator) -> Budget {
        let budget = Budget::of(scene, estimator, &Plan::of(scene), &|| ()).expect("a budget");
        println!("{budget:#?}");
        budget
    }

    fn left_out(budget: &Budget, effect: Effect) -> &Without {
        let mut all = budget.without.iter();
        all.find(|it| it.effect == effect).expect("an effect")
    }

    fn share_of(budget: &Budget, effect: Effect) -> Share {
        left_out(budget, effect).share.expect("a share")
    }

    fn uncertainty_of(share: Share) -> f64 {
        share.uncertainty.expect("many realisations")
    }

    fn rms_without(budget: &Budget, effect: Effect) -> f64 {
        let errors = left_out(budget, effect).errors.as_ref();
        errors.and_then(|errors| errors.rms_px).expect("readings")
    }

    fn rms(budget: &Budget) -> f64 {
        budget.whole.rms_px.expect("readings")
    }

    /// The squares of the errors of independent noises add up. So the shares cover the whole error, except
    /// for the rounding of counts with a variance of 1/12. A black level that does not drift adds nothing,
    /// because the weights sum to zero.
    #[test]
    fn shares_of_independent_noises_add_up_to_one() {
        let budget = budget(&Scene::white_paper());
        let [shot, read] = [Effect::ShotNoise, Effect::ReadNoise].map(|it| share_of(&budget, it));
        let uncertainty = uncertainty_of(shot).hypot(uncertainty_of(read));
        println!("{} of {uncertainty}", shot.value + read.value);
        assert!(uncertainty < 0.15);
        assert!((shot.value + read.value - 1.0).abs() < 3.0 * uncertainty);
        // What either leaves is near the Cramér-Rao bound for it: 1.10 and 1.095 of it, +-0.035 for 400 rows.
        let spot = bound::Spot {
            width: 8.6,
            amplitude: 1750.0,
            noise: 4.0,
            electrons_per_count: None,
        };
        let of_light = with(spot, |it| {
            (it.noise, it.electrons_per_count) = (0.0, Some(10.0))
        });
        for (left_out, left) in [(Effect::ShotNoise, spot), (Effect::ReadNoise, of_light)] {
            let ratio = rms_without(&budget, left_out) / left.bound();
            println!("without {}: {ratio} of the bound", left_out.name());
            assert!((0.99..1.21).contains(&ratio));
        }
        let black = share_of(&budget, Effect::BlackLevel);
        let most = 3.0 * uncertainty_of(black) + 0.02;
        assert!(black.value.abs() < most, "{black:?}");
        assert!(budget.whole.faults.is_empty());
    }

    /// Steps of q give errors of q/sqrt(12), if noise moves the counts over more than one step. The error of
    /// the centre is the same as with read noise of this size.
    #[test]
    fn coarse_steps_cost_the_same_as_read_noise_of_their_size() {
        let paper = Scene::white_paper();
        let noisy = |counts: f64| {
            with(paper.clone(), |it| {
                it.read_noise = Some(ReadNoise { counts })
            })
        };
        let step: f64 = 60.0;
        let stepped = with(noisy(40.0), |it| {
            it.quantisation = Some(Quantisation { step })
        });
        let share = share_of(&budget(&stepped), Effect::Quantisation);
        // The square of the error is a of shot noise and b for each count squared of read noise.
        let [a, with_noise] = [0.0, 40.0].map(|counts| rms(&budget(&noisy(counts))).powi(2));
        let b = (with_noise - a) / 1600.0;
        let of_step = b * step * step / 12.0;
        let expected = of_step / (a + b * 1600.0 + of_step);
        println!("{share:?}, expected {expected}");
        // The mean squares of 400 rows are known to 7 %.
        assert!((share.value - expected).abs() < 3.0 * uncertainty_of(share) + 0.1 * expected);
        assert!(uncertainty_of(share) < 0.1 && expected > 0.1);
    }

    /// If the geometry grows by a factor g, the spot is g times as far from the axis. The growth is even over
    /// ten minutes.
    #[test]
    fn the_error_of_a_warm_sensor_is_that_of_its_geometry() {
        let scene = Scene {
            temperature: Some(Temperature {
                kelvin_per_second: 0.05,
                expansion: 23e-6,
            }),
            distance: 0.65,
            ..Scene::white_paper()
        };
        let budget = budget(&scene);
        let optics = scene.optics;
        let warm = (scene.temperature.expect("listed")).optics(&optics, 300.0);
        let expected = warm.centre(scene.distance) - optics.centre(scene.distance);
        let mean = budget.whole.mean_px.expect("readings");
        println!("mean {mean} px, expected {expected}");
        // The times of 400 readings are even to a percent.
        assert!((mean / expected - 1.0).abs() < 0.02);
        let mean_um = budget.whole.mean_um.expect("readings");
        let slope = -optics.metres_per_pixel(optics.centre(scene.distance)) * 1e6;
        assert!((mean_um / (mean * slope) - 1.0).abs() < 0.01, "{mean_um}");
        // Uniform over 0 .. 2 m: mean square 4/3 m^2, beside the noise of a hundredth of a pixel.
        let share = share_of(&budget, Effect::Temperature);
        assert!(share.value > 0.99, "{share:?}");
    }

    /// The truth moves with the target. Faults are counted with and without the effect.
    #[test]
    fn faults_are_counted_with_and_without_each_effect() {
        let motion = Some(Motion { speed: 0.02 });
        let budget = budget(&with(Scene::white_paper(), |it| it.motion = motion));
        // Smear by 0.4 pixel of a width of 8.6 costs nothing.
        assert!(rms(&budget) < 0.02);
        // A second spot three times as high is beyond full scale, whatever else is left out.
        let double = Scene {
            second_reflection: Some(SecondReflection {
                offset: 30.0,
                width: 8.6,
                strength: 3.0,
            }),
            ..Scene::white_paper()
        };
        let budget = budget_of(&double, Estimator::default());
        let faults = |errors: &Errors| errors.faults.iter().map(|(_, n)| n).sum::<u64>();
        assert_eq!(faults(&budget.whole), 400);
        assert_eq!(budget.whole.rms_px, None);
        for without in &budget.without {
            let errors = without.errors.as_ref().expect("no effect needs another");
            let expected = match without.effect {
                Effect::SecondReflection => 0,
                _ => 400,
            };
            assert_eq!(faults(errors), expected, "{:?}", without.effect);
            assert_eq!(without.share, None);
        }
    }

    /// A reading with a centre in only one of the two runs says nothing about their difference: 1 - (1 + 1) /
    /// (4 + 4).
    #[test]
    fn a_share_uses_only_readings_with_a_centre_in_both_runs() {
        let fault = Err(Fault::Saturated { pixels: 1 });
        let whole = [vec![Ok((2.0, 0.0)), fault], vec![Ok((-2.0, 0.0)), fault]];
        let without = [
            vec![Ok((1.0, 0.0)), Ok((100.0, 0.0))],
            vec![Ok((1.0, 0.0)), fault],
        ];
        let found = share(&whole, &without).expect("two readings");
        assert!((found.value - 0.75).abs() < 1e-12, "{found:?}");
        // Either realisation alone has that share too.
        assert!(uncertainty_of(found) < 1e-12, "{found:?}");
        let faults = || vec![fault, fault];
        assert_eq!(share(&whole, &[faults(), faults()]), None);
    }

    #[test]
    fn the_budget_does_not_depend_on_the_number_of_threads() {
        let scene = Scene::white_paper();
        let plan = Plan {
            realisations: 8,
            readings: 2,
            seconds: 1.0,
        };
        let run = || Budget::of(&scene, Estimator::default(), &plan, &|| ());
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            (pool.expect("threads")).install(|| run().expect("runs"))
        };
        assert_eq!(on(1), on(3));
    }
}
