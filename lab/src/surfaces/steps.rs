//! How far the error of a step differs from the error of a distance.
//!
//! A step is the difference of two distances: before and after the target moves by D along the beam. Speckle
//! moves both distances. If D is small, the sensor sees nearly the same speckle twice, and most of the error
//! cancels. This module measures how much is left, on simulated surfaces without noise, and compares the
//! result with a law ([`variance`]).
//!
//! **How speckle follows a step.** The light of a place x on the target reaches a place u in the slit with
//! the phase k (x sin(theta) + x u cos(theta) / R). Here k is 2 pi / lambda, d the distance, b the baseline,
//! R^2 = b^2 + d^2, sin(theta) = b / R and cos(theta) = d / R. A step changes sin(theta) by -b d D / R^3. The
//! field in the slit therefore slides by b D / R. The laser's spot is a gaussian of 1/e^2 diameter w, so
//! the light in the slit keeps the correlation
//!
//! ```text
//! exp(-(D / L)^2),   L = (2 / pi) lambda R^3 / (w b d).
//! ```
//!
//! The phases k (x^2 + y^2) / 2R also change with the step, but the light loses its correlation by them only
//! over D = (8 / pi) lambda R^3 / (w^2 d), which is 1.3 m for a spot of 1 mm. So the viewing angle limits the
//! memory, not the depth.
//!
//! **The error forgets faster than the light.** The error of a distance is the slope of the field's phase. In
//! a slit much narrower than a speckle, for a small step, the slope loses 1 + M / 4 times the correlation
//! that the light loses. M is the mean of (mean light / light): where the field is dark, the phase changes
//! fastest. The width of the slit keeps M finite. The part of the error that texture makes stays through all
//! steps (microfiber). So [`FACTOR`], which takes the place of 2 / pi, is fitted.
//!
//! A laser with a linewidth smears the speckle along the row, which lengthens the memory. So [`report`] also
//! shows brushed metal in the light of a laser with a single wavelength ([`Measured::single_mode`]): this
//! study fits a factor of its own, and its errors have far tails.
//!
//! **What a small step costs.** For D much shorter than L the law is sqrt(2) s D / L, where s is the error of
//! a distance. s grows with the spot's diameter w, and L falls with it. So the share of the step that
//! is error, sqrt(2) s / L, grows with w^2. It is 0.8 for a spot of 1 mm and full contrast, at 0.8 m.
//!
//! **What a sensor must know.** L = 0.84 mm (R / 0.854 m)^2 is right for a spot of 1 mm and the nominal
//! geometry, to 4 % from 0.6 to 1.0 m. For a smaller spot this L is too short. The claim of a short step is
//! then too large by the ratio of the diameters, and still true. For a spot of 2 mm this L is twice too long,
//! and the claim of a short step is half of what it should be: [`report`] shows how many changes are then
//! within twice the claim. L does not matter for steps over 3 L.
//!
//! The target moves along the beam here. One that also slides sideways sees new speckle sooner.

use simulator::scene::{Effect, LaserSpot};

use crate::budget::row_centre;
use crate::prelude::*;
use crate::surfaces::MATERIALS;
use crate::table;

/// The steps in metres, away from the sensor.
pub const STEPS: [f64; 8] = [10e-6, 30e-6, 100e-6, 300e-6, 1e-3, 3e-3, 10e-3, 30e-3];

/// Surfaces of each material in the table. The relative standard error of an RMS of normal errors is then
/// 1/sqrt(1200) = 2.9 %, and that of a coverage of 95 % is 0.9 %. All materials take about 2 minutes on two
/// cores.
pub const SURFACES: u64 = 600;

/// The memory of the error is this times lambda R^3 / (w b d). [`fitted_factor`] gives 0.57 over all
/// materials. One half is smaller, and so claims more: the claim then also covers white paper, whose error
/// forgets fastest of the six.
pub const FACTOR: f64 = 0.5;

/// A memory twice too long, as a sensor takes it whose laser spot is twice as wide as it believes.
const TOO_LONG: f64 = 2.0 * FACTOR;

/// The surface of [`Measured::single_mode`].
const SINGLE_MODE: (&str, &str) = ("brushed metal, single-mode laser", "brushed-metal");

/// The distances before the step, in metres.
const RANGE: (f64, f64) = (0.62, 1.0);

/// The exposure of each row puts the highest pixel this many counts above the black level. Rounding to whole
/// counts then moves a distance by about 0.2 um, and no row saturates.
const PEAK: f64 = 3000.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// The target's true distance in metres.
    pub distance: f64,
    /// The measured distance less the true one, in metres.
    pub error: f64,
    /// The spot's height in counts per second of exposure.
    pub height: f64,
}

impl Seen {
    /// What the claimed uncertainty c d / sqrt(height) multiplies c with.
    fn weight(&self) -> f64 {
        self.distance / self.height.sqrt()
    }
}

/// The rows of one surface. A row is none if it has a fault.
///
/// Rows with the misfit flag of [`slitrange::check`] stay. At the scenes' exposures the check flags 35 to
/// 80 % of the rows (3 % on tape, which is dim), and keeps the centres of almost all of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    pub first: Option<Seen>,
    pub moved: Vec<Option<Seen>>,
}

#[derive(Clone, Debug)]
pub struct Study {
    pub name: &'static str,
    optics: Optics,
    spot: LaserSpot,
    steps: Vec<f64>,
    surfaces: Vec<Surface>,
}

/// What a material does to one step. Errors are in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Statistics {
    /// RMS of the change of the error, e(d + D) - e(d).
    pub change: f64,
    pub correlation: f64,
    /// Correlation of the two values of e sqrt(height) / d, about zero.
    pub weighted_correlation: f64,
    /// [`Statistics::change`] over the root of the mean of [`variance`].
    pub against_law: f64,
    /// RMS of the change over its own claim, the root of [`variance`]. It is 1 if the claim is right.
    pub over_claim: f64,
    /// Share of the changes within twice the claim.
    pub coverage: f64,
}

/// The step in metres after which the error has lost all but 1/e of its correlation: L = factor lambda R^3 /
/// (w b d). w is the 1/e^2 diameter of the laser's spot on the target.
pub fn memory(factor: f64, optics: &Optics, spot: &LaserSpot, distance: f64) -> f64 {
    let range = optics.range(distance);
    let diameter = spot.diameter(distance, optics.wavelength);
    let depth = distance - optics.offset;
    factor * optics.wavelength * range.powi(3) / (diameter * optics.baseline * depth)
}

/// The variance of the difference of two distances: s1^2 + s2^2 - 2 rho s1 s2, rho = exp(-(D / L)^2). The
/// standard uncertainties s1 and s2 are those of the two distances by speckle, `step` is D and `memory` L.
pub fn variance(before: f64, after: f64, step: f64, memory: f64) -> f64 {
    let rho = (-(step / memory).powi(2)).exp();
    before * before + after * after - 2.0 * rho * before * after
}

/// The scene of a material, in which only speckle and texture move a centre.
pub fn scene(name: &str) -> Result<Scene> {
    let scene = Scene::load(name)?;
    Ok(scene.without(Effect::ShotNoise).without(Effect::ReadNoise))
}

impl Study {
    /// Measures the steps on `count` surfaces. Each has its own seed and its own distance from 0.62 to 1.0 m.
    pub fn run(name: &'static str, scene: Scene, steps: &[f64], count: u64) -> Result<Self> {
        let spot = (scene.laser_spot).with_context(|| format!("{name}: no [laser_spot]"))?;
        let surfaces = (0..count)
            .into_par_iter()
            .map(|number| surface(&scene, steps, number))
            .collect();
        Ok(Self {
            name,
            optics: scene.optics,
            spot,
            steps: steps.to_vec(),
            surfaces,
        })
    }

    fn rows(&self) -> impl Iterator<Item = &Seen> {
        let moved = self.surfaces.iter().flat_map(|it| &it.moved);
        self.surfaces
            .iter()
            .map(|it| &it.first)
            .chain(moved)
            .flatten()
    }

    pub fn excluded(&self) -> (usize, usize) {
        let all = self.surfaces.len() * (1 + self.steps.len());
        (all, all - self.rows().count())
    }

    /// RMS error of a distance, in metres.
    pub fn error(&self) -> f64 {
        rms(self.rows().map(|row| row.error))
    }

    /// c of the claim c d / sqrt(height): the RMS of e sqrt(height) / d.
    pub fn claim(&self) -> f64 {
        rms(self.rows().map(|row| row.error / row.weight()))
    }

    /// The mean of [`memory`] over the surfaces' distances, as small steps see it: the root of
    /// 1 / mean(1 / L^2).
    pub fn memory(&self, factor: f64) -> f64 {
        let first = self.surfaces.iter().filter_map(|it| it.first);
        1.0 / rms(first.map(|row| 1.0 / memory(factor, &self.optics, &self.spot, row.distance)))
    }

    fn pairs(&self, step: usize) -> impl Iterator<Item = (Seen, Seen)> {
        (self.surfaces.iter()).filter_map(move |it| Some((it.first?, it.moved[step]?)))
    }

    /// The change of the error, and its variance by the law, for each pair of a step.
    fn changes(&self, step: usize, factor: f64) -> impl Iterator<Item = (f64, f64)> {
        let claim = self.claim();
        self.pairs(step).map(move |(before, after)| {
            let memory = memory(factor, &self.optics, &self.spot, before.distance);
            let (s1, s2) = (claim * before.weight(), claim * after.weight());
            let variance = variance(s1, s2, self.steps[step], memory);
            (after.error - before.error, variance)
        })
    }

    /// What a step, by its index, does, and how well the law with a factor holds for it.
    pub fn statistics(&self, step: usize, factor: f64) -> Statistics {
        let over_claim = || {
            self.changes(step, factor)
                .map(|(change, v)| change / v.sqrt())
        };
        let change = rms(self.changes(step, factor).map(|(change, _)| change));
        let by_law = rms(self
            .changes(step, factor)
            .map(|(_, variance)| variance.sqrt()));
        let mean = mean(self.pairs(step).flat_map(|(a, b)| [a.error, b.error]));
        Statistics {
            change,
            correlation: cosine(
                self.pairs(step)
                    .map(|(a, b)| (a.error - mean, b.error - mean)),
            ),
            weighted_correlation: cosine(
                (self.pairs(step)).map(|(a, b)| (a.error / a.weight(), b.error / b.weight())),
            ),
            against_law: change / by_law,
            over_claim: rms(over_claim()),
            coverage: statistics::mean(over_claim().map(|z| f64::from(z.abs() < 2.0))),
        }
    }
}

fn surface(scene: &Scene, steps: &[f64], number: u64) -> Surface {
    let seed = scene.seed.wrapping_add(number);
    let simulation = Simulation::new(with(scene.clone(), |it| it.seed = seed));
    // Additive recurrence with the golden ratio: even over the range for any number of surfaces.
    let share = (number as f64 * 0.618_033_988_749_895 + 0.5).fract();
    let (near, far) = RANGE;
    let distance = near + share * (far - near);
    let moved = steps.iter().map(|step| see(&simulation, distance + step));
    Surface {
        first: see(&simulation, distance),
        moved: moved.collect(),
    }
}

fn see(simulation: &Simulation, distance: f64) -> Option<Seen> {
    let scene = simulation.scene();
    let geometry = scene.geometry();
    let row = simulation.row(0, distance, scene.exposure);
    let black = f64::from(row[geometry.shielded.start]);
    let highest = row[geometry.light.clone()]
        .iter()
        .fold(0.0, |a: f32, b| a.max(*b));
    let exposure = scene.exposure * PEAK / (f64::from(highest) - black);
    let row = simulation.row(0, distance, exposure);
    let counts = quantise(&row, geometry.full_scale());
    let centre = row_centre(&counts, &geometry, Estimator::default()).ok()?;
    Some(Seen {
        distance,
        error: scene.optics.distance(centre.centre.to_f64()) - distance,
        height: centre.amplitude.to_f64() / exposure,
    })
}

/// The factor of [`memory`] with which the squares of change over claim have the mean 1, over all studies and
/// all steps up to 1 mm with the same weight. The memory does not matter to longer steps.
pub fn fitted_factor(studies: &[Study]) -> f64 {
    let square = |factor: f64| {
        mean(studies.iter().flat_map(|study| {
            let short = (0..study.steps.len()).filter(|&step| study.steps[step] <= 1e-3);
            short.map(move |step| study.statistics(step, factor).over_claim.powi(2))
        }))
    };
    // The squares grow with the factor: a longer memory claims less.
    let (mut low, mut high) = (0.1, 2.0);
    for _ in 0..20 {
        let middle = 0.5 * (low + high);
        if square(middle) < 1.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[derive(Clone, Debug)]
pub struct Measured {
    pub materials: Vec<Study>,
    pub single_mode: Study,
}

impl Measured {
    fn all(&self) -> impl Iterator<Item = &Study> {
        self.materials.iter().chain([&self.single_mode])
    }
}

/// Measures all materials, and the metal of [`Measured::single_mode`], `count` surfaces each.
pub fn measure(count: u64) -> Result<Measured> {
    let run = |&(name, file): &_| Study::run(name, scene(file)?, &STEPS, count);
    let (name, file) = SINGLE_MODE;
    let metal = scene(file)?;
    let metal = with(metal, |it| {
        it.speckle
            .iter_mut()
            .for_each(|speckle| speckle.linewidth = 0.0);
    });
    Ok(Measured {
        materials: MATERIALS.iter().map(run).collect::<Result<_>>()?,
        single_mode: Study::run(name, metal, &STEPS, count)?,
    })
}

pub fn report(measured: &Measured) -> String {
    let materials = table_of_materials(measured);
    let change = table_of_steps(measured, FACTOR, |step, it| {
        let percent = it.change / STEPS[step] * 100.0;
        format!("{} ({} %)", short(it.change * 1e6), short(percent))
    });
    let correlations = table_of_steps(measured, FACTOR, |_, it| {
        format!("{:.3} ({:.3})", it.weighted_correlation, it.correlation)
    });
    let against = table_of_steps(measured, FACTOR, |_, it| {
        format!("{:.2} ({:.2})", it.over_claim, it.against_law)
    });
    let [coverage, coverage_too_long] = [FACTOR, TOO_LONG].map(|factor| {
        table_of_steps(measured, factor, |_, it| {
            format!("{:.1}", it.coverage * 100.0)
        })
    });
    let (rows, excluded) =
        (measured.all().map(Study::excluded)).fold((0, 0), |sum, it| (sum.0 + it.0, sum.1 + it.1));
    format!(
        "Each material: {} surfaces at 0.62 to 1.0 m, simulated on a PC without noise. {excluded} of {rows} \
         rows have a fault and are left out. The laser has a single wavelength for white paper and in the \
         last line, and a linewidth of 1 nm elsewhere.\n\n{materials}\n\
         RMS of the change of the error in um, in brackets its share of the step:\n\n{change}\n\
         Correlation of the two errors, each times sqrt(height) / d; in brackets without this weight:\n\n\
         {correlations}\n\
         RMS of change over claim, with the memory L = {FACTOR} lambda R^3 / (w b d); in brackets the RMS of \
         the change over the RMS of the claim. The factor that fits the six materials best is {:.2}, and \
         that of the last line {:.2}:\n\n{against}\n\
         Changes within twice the claim, in per cent:\n\n{coverage}\n\
         The same if the claim takes a memory twice as long, as for a spot twice as wide as the sensor \
         believes:\n\n{coverage_too_long}",
        measured.single_mode.surfaces.len(),
        fitted_factor(&measured.materials),
        fitted_factor(std::slice::from_ref(&measured.single_mode)),
    )
}

/// A number with a digit after the point if it is below 10.
fn short(value: f64) -> String {
    let digits = usize::from(value < 9.95);
    format!("{value:.digits$}")
}

fn table_of_materials(measured: &Measured) -> String {
    let rows = measured.all().map(|study| {
        let diameter = study.spot.diameter(0.8, study.optics.wavelength);
        let (error, memory) = (study.error(), study.memory(FACTOR));
        vec![
            study.name.to_owned(),
            format!("{:.0}", error * 1e6),
            format!("{:.2}", diameter * 1e3),
            format!("{:.2}", memory * 1e3),
            format!("{:.2}", std::f64::consts::SQRT_2 * error / memory),
        ]
    });
    let head = "material | RMS error of a distance, um | spot's 1/e² diameter at 0.8 m, mm | memory L, mm \
                | √2 e / L";
    table::of(head, rows)
}

/// A row for each study, a column for each of [`STEPS`]. The claims have the memory of a factor.
fn table_of_steps(
    measured: &Measured,
    factor: f64,
    cell: impl Fn(usize, &Statistics) -> String,
) -> String {
    let steps = STEPS.map(|step| format!("{} mm", (step * 1e6).round() / 1e3));
    let rows = measured.all().map(|study| {
        let cells = (0..STEPS.len()).map(|step| cell(step, &study.statistics(step, factor)));
        [study.name.to_owned()].into_iter().chain(cells).collect()
    });
    table::of(&format!("material | {}", steps.join(" | ")), rows)
}

/// The sum of products over the root of the products of the sums of squares.
fn cosine(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (aa, bb, ab) = pairs.fold((0.0, 0.0, 0.0), |(aa, bb, ab), (a, b)| {
        (aa + a * a, bb + b * b, ab + a * b)
    });
    ab / (aa * bb).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 200 surfaces of white paper. On 1500 surfaces the RMS of change over claim is 1.09 for a step of
    /// 0.1 mm and 0.99 for one of 3 mm: the law holds to 10 %. The values have a kurtosis of up to 4.4. So
    /// the relative standard error of their RMS on n surfaces is sqrt((4.4 - 1) / 4n). The band is 10 % and
    /// four of these. The coverage on 1500 surfaces is 93.9 % and 95.7 %; the bound is four binomial standard
    /// errors below 93.9 %.
    #[test]
    fn the_law_holds_on_white_paper() {
        const COUNT: u64 = 200;
        let (name, file) = MATERIALS[0];
        let scene = scene(file).expect("a scene");
        let study = Study::run(name, scene, &[1e-4, 3e-3], COUNT).expect("a laser spot");
        assert_eq!(study.excluded(), (3 * COUNT as usize, 0));
        let band = 0.1 + 4.0 * (3.4 / (4.0 * COUNT as f64)).sqrt();
        let least = 0.939 - 4.0 * (0.939 * 0.061 / COUNT as f64).sqrt();
        for step in 0..2 {
            let found = study.statistics(step, FACTOR);
            println!("{found:?}, band {band:.2}, least coverage {least:.3}");
            assert!((found.over_claim - 1.0).abs() < band);
            assert!(found.coverage > least);
        }
        // The band tells the law from one without a memory, which is far too large for the short step ...
        assert!(study.statistics(0, 1e-3).over_claim < 1.0 - band);
        // ... and from one with a memory twice as long, which is too small.
        assert!(study.statistics(0, TOO_LONG).over_claim > 1.0 + band);
    }

    /// At 0.8 m, R = 0.8544 m, with a spot of 1 mm: 0.5 * 650e-9 * 0.8544^3 / (1e-3 * 0.3 * 0.8) = 0.8446 mm.
    #[test]
    fn the_memory_of_a_spot_of_1_mm_is_0_84_mm() {
        let spot = LaserSpot::new(1e-3, 0.8);
        let memory = memory(0.5, &Optics::nominal(), &spot, 0.8);
        assert!((memory - 0.8446e-3).abs() < 1e-7, "{memory}");
    }

    #[test]
    fn the_law_goes_from_the_difference_to_the_sum_of_the_errors() {
        assert_eq!(variance(3.0, 4.0, 0.0, 1.0), 1.0);
        assert_eq!(variance(3.0, 4.0, 100.0, 1.0), 25.0);
    }
}
