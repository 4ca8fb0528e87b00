//! The recognition of tops that are cut off below full scale: false alarms, detections, and confident errors
//! with wells that the geometry states and wells that it does not.

use crate::support::*;
use judges::hard_cases::judge::{Answer, Answers, answers};

/// Whether the check finds a top to be flat that the estimator takes for a spot. No fit is among the
/// estimators here: a fit measures such a spot by its flanks.
fn is_recognised(answers: &Answers) -> bool {
    let is_saturated = |answer: &Answer| matches!(answer, Err(Fault::Saturated { .. }));
    !is_saturated(&answers.alone) && is_saturated(&answers.checked)
}

const ADAPTIVE: usize = Estimator::Adaptive as usize;

fn is_recognised_by_any(row: &HardRow) -> bool {
    let answers = answers(row);
    let by = Estimator::ALL.iter().zip(&answers);
    by.filter(|(it, _)| **it != Estimator::GaussNewton)
        .any(|(_, answers)| is_recognised(answers))
}

/// Rows of symmetric spots that no well cuts: gaussians and slit patterns, 0.8 to 30 pixels wide. For a
/// gaussian the derivation in the core allows one false alarm in 10^5 rows for each estimator. The four
/// estimators see the same rows, so this is also the limit here, plus three standard deviations. The slit
/// patterns keep it, too.
#[test]
fn clean_tops_are_not_taken_for_flat_ones() {
    const ROWS: u64 = 60_000;
    let seeds = (1 << 41..(1 << 41) + ROWS).into_par_iter();
    let found = seeds.filter(|&seed| is_recognised_by_any(&mixtures::clean(seed).row()));
    let found: Vec<u64> = found.collect();
    let most = (1e-5 * ROWS as f64) + 3.0 * (1e-5 * ROWS as f64).sqrt();
    println!("of {ROWS} clean rows ({most:.0} allowed): {found:?}");
    assert!(found.len() as f64 <= most);
}

/// The same for the scenes whose spots speckle distorts: each row has other speckle. At most one row in
/// 100: speckle may by chance level a top to within the noise. Of 1500 rows a scene none was taken.
#[test]
#[ignore = "takes 6 CPU s; run by .ci/run"]
fn speckle_is_seldom_taken_for_a_flat_top() {
    const ROWS: u64 = 150;
    for name in "speckle-at-rest brushed-metal microfiber light-wood".split(' ') {
        let scene = scene(name);
        let (distance, exposure) = (scene.distance, scene.exposure);
        let geometry = scene.geometry();
        let found = (0..ROWS).into_par_iter().map(|number| {
            let simulation = Simulation::on_surface(scene.clone(), number);
            let row = light_of(&simulation.row(number, distance, exposure), &geometry);
            let is_measured = answers(&row)[ADAPTIVE].alone.is_ok();
            is_measured.then(|| is_recognised_by_any(&row))
        });
        let found: Vec<Option<bool>> = found.collect();
        let measured = found.iter().flatten().count();
        let flat = found.iter().flatten().filter(|it| **it).count();
        println!("{name}: {flat} of {measured} rows with a centre, {ROWS} rows");
        assert!(2 * measured > ROWS as usize, "{name}: {measured}");
        assert!(flat * 100 <= measured, "{name}: {flat} of {measured}");
    }
}

fn light_of(counts: &[f32], geometry: &Geometry) -> HardRow {
    let light = quantise(&counts[geometry.light.clone()], geometry.full_scale());
    let own = self::geometry(light.len(), geometry.shot_variance_per_count_q16);
    HardRow {
        geometry: with(own, |it| it.saturation = geometry.saturation),
        light,
        truth: Truth::None,
    }
}

/// Per cent of the rows whose flat top the default estimator recognises, by the well's level, the width and
/// how many times the spot fills the well. The test asserts nine of ten from 1.2 times on for a width of 8.6
/// pixels or more and a well of 1500 counts or more, from 1.5 times on for a width of 4 pixels or more, and
/// from 4 times on for all. At 1.2 times a gaussian is flat over 1.2 widths, at 1.5 over 1.8 and at 4 over
/// 3.3: 10, 7 and 5 pixels, or four degrees of freedom. Four with an r of 1 % are enough.
fn recognise_tops_cut_by_a_well(rows_of_each: u64) {
    const TIMES: [f64; 6] = [1.05, 1.1, 1.2, 1.5, 2.0, 4.0];
    println!("per cent recognised at {TIMES:?} times the well");
    for (electrons_per_count, read_noise) in [(Some(10.0), 4.0), (Some(5.0), 2.0), (None, 2.0)] {
        for (level, width) in pairs([800, 1500, 2500], [1.5, 2.5, 4.0, 8.6, 20.0, 60.0]) {
            let shares = TIMES.map(|times| {
                let recipe = with(Recipe::clean(width), |it| {
                    it.pixels = if width < 15.0 { 512 } else { 2048 };
                    (it.electrons_per_count, it.read_noise) = (electrons_per_count, read_noise);
                });
                let height = times * (f64::from(level) - recipe.black_level);
                let recipe = recipe.spot(|spot| spot.amplitude = height);
                let recipe = recipe.with_well(level, false);
                let found_in = |row: &HardRow| is_recognised(&answers(row)[ADAPTIVE]);
                let [found] = tally(rows_of_each, |it| [found_in(&recipe.row(77, it)).into()]);
                100.0 * found as f64 / rows_of_each as f64
            });
            let electrons = electrons_per_count.unwrap_or(f64::INFINITY);
            print!("{electrons:>4} e/count, noise {read_noise}, well {level:>4}, ");
            println!("sigma {width:>4}: {shares:?}");
            // Fewer pixels and less light give less evidence.
            let least = match (width, level) {
                (8.6.., 1500..) => 1.2,
                (4.0.., _) => 1.5,
                _ => 4.0,
            };
            for (times, share) in TIMES.into_iter().zip(shares) {
                let is_enough = times < least || share >= 90.0;
                assert!(is_enough, "{level} {width} {times}: {share}");
            }
        }
    }
}

#[test]
fn tops_cut_by_a_well_are_recognised() {
    recognise_tops_cut_by_a_well(40);
}

#[test]
#[ignore = "65,000 rows take 13 CPU s; run by .ci/run"]
fn tops_cut_by_a_well_are_recognised_in_many_rows() {
    recognise_tops_cut_by_a_well(200);
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Cut {
    /// The converter's largest word.
    FullScale,
    /// A well of 2500 counts that the geometry states.
    Known,
    /// The same, which the geometry does not state.
    Unknown,
}

/// A row as [`mixtures::clean`] draws it, but with a spot of 1.02 to 4 times what is cut.
fn cut_row(cut: Cut, seed: u64) -> HardRow {
    const WELL: u16 = 2500;
    let mut recipe = mixtures::clean(seed).recipe;
    let mut random = random(!seed);
    let times = 1.02 * (4.0f64 / 1.02).powf(random.random());
    let level = if cut == Cut::FullScale { 4095 } else { WELL };
    let height = times * (f64::from(level) - recipe.black_level);
    recipe = recipe.spot(|spot| spot.amplitude = height);
    if cut != Cut::FullScale {
        recipe = recipe.with_well(level, cut == Cut::Known);
    }
    recipe.row(seed, 0)
}

/// Rows whose top is cut off: with a well of 2500 counts, every estimator makes no more confident errors than
/// with the same spots at full scale. This holds for a well that the geometry states and for one that it does
/// not. What noise may add is three standard deviations of the binomial distribution.
#[test]
fn a_well_below_full_scale_causes_no_more_confident_errors() {
    const ROWS: u64 = 6000;
    let tally = |cut: Cut| -> [[u64; 4]; Estimator::ALL.len()] {
        let all = tally::<{ 4 * Estimator::ALL.len() }>(ROWS, |seed| {
            let row = cut_row(cut, (1 << 42) + seed);
            let of_each = answers(&row).map(|it| {
                let said = Said::of_row(row.truth, &it.checked);
                let sure = said.unflagged().is_some();
                let alone = Said::of_row(row.truth, &it.alone).is_confident_error();
                [said.is_confident_error(), sure, it.checked.is_err(), alone].map(u64::from)
            });
            std::array::from_fn(|i| of_each[i / 4][i % 4])
        });
        std::array::from_fn(|i| std::array::from_fn(|part| all[4 * i + part]))
    };
    let [full_scale, known, unknown] = [Cut::FullScale, Cut::Known, Cut::Unknown].map(tally);
    println!("of {ROWS} rows: confident errors, unflagged, faults; errors of the estimator alone");
    for (i, estimator) in Estimator::ALL.iter().enumerate() {
        let (name, all) = (estimator.name(), [full_scale[i], known[i], unknown[i]]);
        println!("{name:>12}: full scale, known well, unknown well {all:?}");
    }
    for (i, estimator) in Estimator::ALL.iter().enumerate() {
        let name = estimator.name();
        let reference = full_scale[i][0] as f64;
        let most = |reference: f64| reference + 3.0 * reference.max(1.0).sqrt();
        // An estimator alone does not recognise a flat top: it goes by the geometry.
        let alone = [full_scale[i][3], known[i][3]].map(|errors| errors as f64);
        assert!(alone[1] <= most(alone[0]), "{name}: {alone:?}");
        for (well, errors) in [("known", known[i][0]), ("unknown", unknown[i][0])] {
            assert!(errors as f64 <= most(reference), "{name} {well}: {errors}");
        }
    }
}
