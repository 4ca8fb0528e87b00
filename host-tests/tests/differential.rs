//! The core against other computations: the fixed-point estimators against models of them in f64, and the
//! least-squares fit against a reference.

use crate::model;
use crate::model::phase_table::{Found, Weights};
use crate::support::{self, *};
use phase_tables::{DEFAULT, FRAUNHOFER, Profile, gaussian, slit};
use simulator::least_squares::{Gaussian, fit_weighted};
use slitrange::centre::tables;

/// Steps of a centre in a pixel.
const STEPS: f64 = 65536.0;

/// A row with a spot of any width, height and noise.
struct Drawn {
    cell: Cell,
    geometry: Geometry,
    light: Vec<u16>,
    spot: Spot,
}

fn logarithmic(random: &mut ChaCha8Rng, least: f64, most: f64) -> f64 {
    random.random_range(least.ln()..most.ln()).exp()
}

/// The `number`-th of the rows of a seed, where the search finds its spot.
fn drawn(seed: u64, number: u64) -> Option<Drawn> {
    let random = &mut random(seed);
    random.set_stream(number);
    let width = logarithmic(random, 0.8, 100.0);
    let amplitude = logarithmic(random, 50.0, 3500.0);
    let read_noise = logarithmic(random, 0.5, 20.0);
    let has_shot_noise = random.random_bool(0.5);
    let electrons_per_count = has_shot_noise.then(|| random.random_range(2.0..20.0));
    let cell = support::cell(width, amplitude, (read_noise, electrons_per_count), 0, seed);
    let scene = cell.scene_of(PIXELS);
    let truth = cell.true_centre(number);
    let light = quantise(&scene.row_with_centre(number, truth, 1.0), 4095);
    Some(Drawn {
        cell,
        geometry: scene.geometry(),
        spot: support::find(&light).ok()?,
        light,
    })
}

impl Drawn {
    fn centre(&self, estimator: Estimator) -> Option<RowCentre> {
        let row = support::row(&self.light);
        centre::centre(estimator, &row, &self.spot, None, &self.geometry).ok()
    }
}

struct Pair {
    found: RowCentre,
    noise: f64,
    model: Found,
    /// The estimator's centre less the model's, in steps of 2^-16 pixel.
    steps: f64,
}

/// Rows that are drawn: of every width, height and noise.
const ROWS: u64 = 21_000;

/// Every row for which the estimator finds a centre, with the model's. It finds one too.
fn pairs(estimator: Estimator, weights: &[Weights]) -> Vec<Pair> {
    let pairs = (0..ROWS).into_par_iter().filter_map(|number| {
        let drawn = drawn(3, number)?;
        let found = drawn.centre(estimator)?;
        let model = model::phase_table::centre(&drawn.light, &drawn.spot, weights);
        let cell = drawn.cell;
        let model = model.unwrap_or_else(|| panic!("{cell:?}: {found:?}, none by the model"));
        let steps = f64::from(found.centre.to_bits()) - model.centre * STEPS;
        Some(Pair {
            found,
            noise: drawn.spot.background.noise.to_f64(),
            model,
            steps,
        })
    });
    pairs.collect()
}

impl Pair {
    fn of_claim(&self) -> f64 {
        self.steps / f64::from(self.found.uncertainty.to_bits())
    }
}

fn worst(values: impl Iterator<Item = f64>) -> f64 {
    values.map(f64::abs).fold(0.0, f64::max)
}

/// Compares the phase tables in fixed point and f32 with the same integer tables in f64. A centre is rounded
/// to 2^-16 pixel: an error of 1/sqrt(12) = 0.289 steps root mean square, and of half a step at most. If a
/// table has three phases, the place of a phase is cut off by up to a third of a step more. f32 adds a few
/// parts in 2^24 of the distance from the phase, which is about a pixel.
///
/// Near the border between two windows, the estimator and its model may take different windows. Their centres
/// then differ by a small part of the uncertainty. This happens in a few rows of 20,000.
///
/// Samples of 16 pixels are halved sums, and the halving cuts off half a count in every second sample. This
/// is a noise of 1/4 count in a sample whose noise has four times a pixel's variance. So the error is 1/8 of
/// the uncertainty, divided by the noise of a pixel.
#[test]
fn fixed_point_agrees_with_its_model_in_f64() {
    let gaussian = model::phase_table::integer(tables::GAUSSIAN.tables());
    let slit = model::phase_table::integer(tables::SLIT.tables());
    println!("off by, in steps of 2^-16 pixel:");
    for (estimator, weights) in [
        (Estimator::PhaseTable, &gaussian),
        (Estimator::Fraunhofer, &slit),
    ] {
        let is_halved = |pair: &Pair| pair.model.block == 16 || pair.found.class.block == 16;
        let pairs = pairs(estimator, weights).into_iter();
        let (halved, whole): (Vec<Pair>, Vec<Pair>) = pairs.partition(is_halved);
        let (same, other): (Vec<&Pair>, Vec<&Pair>) =
            whole.iter().partition(|pair| pair.steps.abs() <= 1.0);
        let rms_same = rms(same.iter().map(|pair| pair.steps));
        let worst_same = worst(same.iter().map(|pair| pair.steps));
        let all = rms(whole.iter().map(|pair| pair.steps)) / STEPS;
        let worst_other = worst(other.iter().map(|pair| pair.of_claim()));
        let cut_off = rms(halved.iter().map(|pair| pair.of_claim() * 8.0 * pair.noise));
        let rows = [same.len(), other.len(), halved.len()];
        println!("{estimator:?}, {rows:?} rows of the same window, of another, of halved sums:");
        print!("{rms_same:.3} rms, {worst_same:.3} at most; {worst_other:.3} of the uncertainty, ");
        println!("{all:.1e} px rms with them; {cut_off:.2} of 1/8 over the noise");
        let is_near = rms_same <= 0.31 && worst_same <= 0.84 && all <= 5e-5;
        assert!(is_near, "{estimator:?}");
        assert!(other.len() <= 5 && worst_other <= 0.1, "{estimator:?}");
        assert!(halved.len() >= 100 && cut_off <= 1.1, "{estimator:?}");
        for Pair { found, model, .. } in same {
            let class = (found.class.block, usize::from(found.class.table));
            let of_model = (model.block, model.table);
            assert_eq!(class, of_model, "{estimator:?}: {found:?}, {model:?}");
        }
    }
}

/// Compares the tables of 16 bits with the tables in f64, on the rows where both lead to the same window. The
/// rounding of the weights adds a noise of a few thousandths of the noise of the row.
#[test]
fn integer_tables_agree_with_the_designed_tables() {
    let (gaussian, slit): (Profile<'_>, Profile<'_>) = (&gaussian, &slit);
    for (estimator, profile, plan, set) in [
        (Estimator::PhaseTable, gaussian, DEFAULT, &tables::GAUSSIAN),
        (Estimator::Fraunhofer, slit, FRAUNHOFER, &tables::SLIT),
    ] {
        let integer = model::phase_table::integer(set.tables());
        let exact = model::phase_table::exact(profile, plan);
        let both = (0..ROWS).into_par_iter().filter_map(|number| {
            let drawn = drawn(3, number)?;
            let found = drawn.centre(estimator)?;
            let [integer, exact] = [&integer, &exact]
                .map(|weights| model::phase_table::centre(&drawn.light, &drawn.spot, weights));
            let (integer, exact) = (integer?, exact?);
            let place = |found: &Found| (found.block, found.table, found.window);
            let apart = integer.centre - exact.centre;
            let same = place(&integer) == place(&exact);
            Some(same.then_some([apart, apart / found.uncertainty.to_f64()]))
        });
        let both: Vec<Option<[f64; 2]>> = both.collect();
        let same: Vec<[f64; 2]> = both.iter().copied().flatten().collect();
        let pixels = rms(same.iter().map(|[pixels, _]| *pixels));
        let of_claim = rms(same.iter().map(|[_, of_claim]| *of_claim));
        let (same, all) = (same.len(), both.len());
        print!("{estimator:?}: {of_claim:.4} of the claim, ");
        println!("{pixels:.1e} px, {same} of {all} rows");
        assert!(of_claim <= 0.003, "{estimator:?}: {of_claim}");
        assert!(100 * same >= 98 * all, "{estimator:?}");
    }
}

/// Compares the sums of the centroid in fixed point with eq. (2) in f64. The window comes to rest if it moves
/// by less than 2^-8 pixel. If a move is close to this limit, one of the two windows moves once more, by
/// about 3 % of the limit and some noise.
#[test]
fn the_centroid_agrees_with_its_model() {
    let steps = (0..ROWS).into_par_iter().filter_map(|number| {
        let drawn = drawn(3, number)?;
        let found = drawn.centre(Estimator::Centroid)?;
        let model = model::centroid(&drawn.light, &drawn.spot)?;
        Some(f64::from(found.centre.to_bits()) - model * STEPS)
    });
    let steps: Vec<f64> = steps.collect();
    let (same, other): (Vec<f64>, Vec<f64>) = steps.iter().partition(|steps| steps.abs() <= 1.0);
    let (all, most) = (rms(&steps), largest(&other));
    let (of_same, rows) = (rms(&same), [same.len(), other.len()]);
    let all = all / STEPS;
    print!("{rows:?} rows, at rest at the same place and elsewhere: {of_same:.3} steps rms; ");
    println!("{most:.1} steps of 2^-16 pixel away at most, {all:.1e} px rms with them");
    // A thousandth of the windows rest within 2^-10 of their border by chance.
    assert!(all <= 5e-5 && other.len() <= 20 && most <= 64.0);
}

/// Compares eq. (1) in 64-bit integers with f64: a distance is rounded to 2^-8 um. The second comparison
/// starts from the row. There the steps of the centre add an error, because a step of the centre changes the
/// distance by several of its own steps.
#[test]
fn distances_agree_with_the_model() {
    // The default's curve, over all centres of the rows.
    let nominal = NOMINAL.expect("a curve");
    let valid = Pixels::from_int(0)..=Pixels::from_int(PIXELS as i32);
    let curve = Eq1::new(nominal.d(), nominal.k(), nominal.pole(), valid).expect("a curve");
    let tables = model::phase_table::integer(tables::GAUSSIAN.tables());
    let (mut alone, mut whole) = (vec![], vec![]);
    for Pair {
        found,
        model,
        steps,
        ..
    } in pairs(Estimator::PhaseTable, &tables)
    {
        let (distance, slope) = curve.distance_at(found.centre).expect("a valid centre");
        let off = |centre| f64::from(distance.to_bits()) - 256.0 * model::distance(&curve, centre);
        alone.push(off(found.centre.to_f64()));
        if steps.abs() <= 1.0 {
            whole.push(off(model.centre));
            let most = 0.5 + f64::from(slope).abs() * 256.0 * steps.abs() / STEPS;
            let (off, most) = (off(model.centre).abs(), 1.0001 * most + 1e-3);
            assert!(off <= most, "{off} of {most} steps at {}", found.centre);
        }
    }
    let (alone_rms, alone_most) = (rms(&alone), largest(&alone));
    let (from_row, rows) = ([rms(&whole), largest(&whole)], whole.len());
    println!("eq. (1): {alone_rms:.3} steps of 2^-8 um rms, {alone_most:.3} at most");
    println!("from the row on: {from_row:.2?} of {rows} rows");
    assert!(whole.len() >= 20_000 && alone_rms <= 0.30 && alone_most <= 0.501);
}

/// Compares the least-squares estimator in f32 with a Levenberg-Marquardt fit in f64 of the same pixels with
/// the same weights. They differ by at most a hundredth of the uncertainty.
///
/// Compares the default estimator with the same reference too. The error of an estimate at the bound is not
/// correlated with its distance from another unbiased estimate (C. R. Rao, 1952). So the correlation of the
/// two errors equals the ratio of their sizes: the bound over the error of the default. The standard error of
/// the difference is 0.006 over 4000 rows.
#[test]
fn the_fit_agrees_with_the_reference_and_the_tables_come_near_it() {
    for (width, amplitude, noise) in [
        (1.2, 1000.0, (4.0, None)),
        (4.0, 200.0, (8.0, None)),
        (10.5, 100.0, (4.0, None)),
        (2.0, 1000.0, (2.0, Some(5.0))),
        (10.5, 2000.0, (2.0, Some(5.0))),
    ] {
        let cell = support::cell(width, amplitude, noise, 4000, 5);
        let scene = cell.scene_of(PIXELS);
        let geometry = scene.geometry();
        let fits = (0..cell.rows).into_par_iter().map(|number| {
            let truth = cell.true_centre(number);
            let light = quantise(&scene.row_with_centre(number, truth, 1.0), 4095);
            Fits::of(&light, truth, &geometry).expect("all three find the spot")
        });
        let fits: Vec<Fits> = fits.collect();
        let apart = |fits: &Fits| (fits.fit - fits.reference) / fits.uncertainty;
        let (apart_rms, apart_most) = (rms(fits.iter().map(apart)), worst(fits.iter().map(apart)));
        let reference = rms(fits.iter().map(|fits| fits.reference));
        let table = rms(fits.iter().map(|fits| fits.table));
        let product = statistics::mean(fits.iter().map(|fits| fits.reference * fits.table));
        let (ratio, correlation) = (reference / table, product / reference / table);
        let bound = cell.spot().bound();
        let of_bound = [reference, table].map(|it| it / bound);
        println!("sigma {width}, {amplitude} counts, {noise:?}: fit and reference apart by");
        println!("{apart_rms:.4} of the uncertainty rms, {apart_most:.3} at most;");
        println!("of the bound {of_bound:.3?}, ratio {ratio:.3}, correlation {correlation:.3}");
        assert!(apart_rms <= 0.003 && apart_most <= 0.02, "{width}");
        // The standard error of a root mean square over 4000 rows is 1.1 %.
        assert!((reference / bound - 1.0).abs() <= 0.04, "{width}");
        assert!((correlation - ratio).abs() <= 0.02, "{width}");
    }
}

/// What three ways make of a row: their errors in pixels.
struct Fits {
    fit: f64,
    table: f64,
    reference: f64,
    uncertainty: f64,
}

impl Fits {
    fn of(light: &[u16], truth: f64, geometry: &Geometry) -> Option<Self> {
        let (row, spot) = (support::row(light), support::find(light).ok()?);
        let centre = |estimator| centre::centre(estimator, &row, &spot, None, geometry).ok();
        let fit = centre(Estimator::GaussNewton)?;
        let table = centre(Estimator::PhaseTable)?;
        // The fit's 128 samples of one pixel, around where its half maximum says that the spot is.
        let half = half_width::find(light.into(), &spot).ok()?;
        let (left, right) = (half.left?, half.right?);
        let start = half.top.to_f64() + 0.5 * (right.to_f64() - left.to_f64());
        let first = (start.floor() as usize).checked_sub(64)?;
        let pixels = light.get(first..first + 128)?.iter();
        let pixels: Vec<f64> = pixels.map(|&count| f64::from(count)).collect();
        let full_width = Pixels::from_bits(left.to_bits() + right.to_bits());
        let start = Gaussian {
            centre: start,
            width: half.sigma(full_width).to_f64(),
            amplitude: half.height.to_f64(),
            level: spot.background.level.to_f64(),
        };
        let noise = spot.background.noise.to_f64().powi(2);
        let shot = f64::from(geometry.shot_variance_per_count_q16) / 65536.0;
        let weight =
            |found: &Gaussian, pixel| 1.0 / (noise + shot * (found.at(pixel) - found.level));
        let reference = fit_weighted(&pixels, first, start, weight)?;
        Some(Self {
            fit: fit.centre.to_f64() - truth,
            table: table.centre.to_f64() - truth,
            reference: reference.centre - truth,
            uncertainty: fit.uncertainty.to_f64(),
        })
    }
}
