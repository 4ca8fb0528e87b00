//! Many seeded rows through the core: how far its centres lie from the truth, and from what it claims.
//!
//! [`Cell::run`] takes each row by itself. [`Rows`] come as the firmware reads them: in series of [`SERIES`]
//! rows of one spot, with independent noise, in which the spot drifts; each estimator is given what itself
//! found in the row before, except in a series' first row, and all estimators see the same rows.
//! [`Phases::bias`] is what is left without noise.

use phase_tables::gaussian;
use rayon::prelude::*;
use simulator::bound;
use simulator::scene::{BlackLevel, ReadNoise, Scene, Sensor, ShotNoise, Spot, quantise};
use slitrange::centre::tables::TableSet;
use slitrange::centre::{self, phase_table};
use slitrange::measurement::centre_of_spot;
use slitrange::spot;
use slitrange::{Estimator, Fault, Geometry, Row, RowCentre};

/// Pixels of a test row: enough for the background of the widest spot.
pub const PIXELS: usize = 2048;
/// A row's centre, or why there is none.
pub type Answer = Result<RowCentre, Fault>;

/// One row of counts, light positive, through the spot search and an estimator.
pub fn centre_of(geometry: &Geometry, light: &[u16], estimator: Estimator) -> Answer {
    centre_after(None, geometry, light, estimator)
}

/// The same with what the estimator found in the row before.
pub fn centre_after(
    before: Option<&RowCentre>,
    geometry: &Geometry,
    light: &[u16],
    estimator: Estimator,
) -> Answer {
    let row = Row::new(light, &[], geometry.saturated_from()).expect("quantised to 12 bits");
    centre::centre(estimator, &row, &spot::find(&row)?.0, before, geometry)
}

/// The same with tables of the caller's.
pub fn centre_with(
    tables: &TableSet<'_>,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    light: &[u16],
) -> Answer {
    let row = Row::new(light, &[], geometry.saturated_from()).expect("quantised to 12 bits");
    let (spot, _) = spot::find(&row)?;
    phase_table::centre(&row, &spot, before, geometry, tables)
}

/// What an estimator alone finds in a row, and what the measurement finds with it.
pub fn answers(geometry: &Geometry, light: &[u16], estimator: Estimator) -> [Answer; 2] {
    let row = Row::new(light, &[], geometry.saturated_from()).expect("quantised to 12 bits");
    let found = spot::find(&row);
    [
        found.and_then(|(spot, _)| centre::centre(estimator, &row, &spot, None, geometry)),
        found.and_then(|(spot, budget)| {
            centre_of_spot(estimator, &row, &spot, None, geometry, None, budget)
        }),
    ]
}

/// One cell of a table: a spot and its noise, on a row of at most [`PIXELS`].
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    /// Sigma in pixels.
    pub width: f64,
    /// Height in counts.
    pub amplitude: f64,
    /// Read noise in counts.
    pub read_noise: f64,
    /// Electrons a count, where the spot has shot noise.
    pub electrons_per_count: Option<f64>,
    /// Rows to run.
    pub rows: u64,
    /// Seed.
    pub seed: u64,
}

/// What came of a cell. Every row that has a centre counts, a gross error as any other.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Root mean square error in pixels.
    pub rmse: f64,
    /// The Cramér-Rao bound in pixels.
    pub bound: f64,
    /// Standard deviation of error over claimed uncertainty.
    pub pull: f64,
    /// Rows without a centre.
    pub faults: u64,
    /// Rows whose centre is off by more than half a width and eight times the bound.
    pub gross: u64,
}

impl Outcome {
    /// RMSE over the bound.
    pub fn ratio(&self) -> f64 {
        self.rmse / self.bound
    }
}

impl Cell {
    /// Its spot without noise, for a sensor without shot noise.
    pub const fn noiseless(width: f64, amplitude: f64) -> Self {
        Self {
            width,
            amplitude,
            read_noise: 0.0,
            electrons_per_count: None,
            rows: 0,
            seed: 0,
        }
    }

    /// The spot whose bound it is compared with.
    pub const fn spot(&self) -> bound::Spot {
        bound::Spot {
            width: self.width,
            amplitude: self.amplitude,
            noise: self.read_noise,
            electrons_per_count: self.electrons_per_count,
        }
    }

    /// The error in pixels from which on it is gross.
    fn gross(&self) -> f64 {
        (0.5 * self.width).max(8.0 * self.spot().bound())
    }

    /// Pixels of a row: enough for the spot's background, and no more, because making rows takes the time.
    pub fn pixels(&self) -> usize {
        match self.width {
            width if width <= 3.0 => 512,
            width if width <= 8.0 => 1024,
            _ => PIXELS,
        }
    }

    /// The scene that the cell stands for.
    pub fn scene(&self) -> Scene {
        self.scene_of(self.pixels())
    }

    /// The same with rows of another length.
    pub fn scene_of(&self, pixels: usize) -> Scene {
        let counts = self.read_noise;
        let black_level = (8.0 * counts).clamp(60.0, 1000.0).round();
        Scene {
            seed: self.seed,
            black_level: Some(BlackLevel::steady(black_level)),
            spot: Some(Spot::new(self.width, self.amplitude)),
            shot_noise: self.electrons_per_count.map(ShotNoise::of),
            read_noise: (self.read_noise > 0.0).then_some(ReadNoise { counts }),
            ..Scene::dark(Sensor::Row(pixels))
        }
    }

    /// The true centre of a row: over the phases evenly, over the row's middle 200 pixels at random.
    pub fn true_centre(&self, row: u64) -> f64 {
        const GOLDEN: f64 = 0.618_033_988_749_895;
        let place = (row as f64 * 7.0 * GOLDEN).fract();
        self.pixels() as f64 / 2.0 - 100.0 + (place * 200.0).floor() + (row as f64 * GOLDEN).fract()
            - 0.5
    }

    /// A row's counts on so many pixels, and where its spot is.
    pub fn light(&self, pixels: usize, row: u64) -> (Vec<u16>, f64) {
        let truth = self.true_centre(row);
        let counts = self.scene_of(pixels).row_with_centre(row, truth, 1.0);
        (quantise(&counts, 4095), truth)
    }

    /// Runs something that finds centres over the rows, which have so many pixels.
    pub fn run(
        &self,
        pixels: usize,
        centre: impl Fn(&Geometry, &[u16]) -> Answer + Sync,
    ) -> Outcome {
        let geometry = self.scene_of(pixels).geometry();
        // Collected in order before they are added up: the sums are then the same on any number of cores.
        let rows = (0..self.rows).into_par_iter().map(|row| {
            let (light, truth) = self.light(pixels, row);
            (centre(&geometry, &light), truth)
        });
        let centres: Vec<(Answer, f64)> = rows.collect();
        let (mut sums, gross) = (Sums::default(), self.gross());
        for (centre, truth) in centres {
            sums.count(centre, truth, gross);
        }
        sums.outcome(self)
    }
}

/// Rows in a series.
pub const SERIES: u64 = 16;
/// The spot drifts by up to this many pixels a row, either way: 30 mm/s of a target at 0.8 m and 175 rows a
/// second.
const FASTEST_DRIFT: f64 = 0.6;
/// Additive recurrence, the most even in two dimensions: 1/p and 1/p^2 of the plastic number p^3 = p + 1.
const EVEN: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_2];

/// A function that finds centres as [`centre::centre`] does, by any of several methods `M`.
pub trait Find<M>:
    Fn(M, &Row<'_>, &spot::Spot, Option<&RowCentre>, &Geometry) -> Answer + Sync
{
}

impl<M, F> Find<M> for F where
    F: Fn(M, &Row<'_>, &spot::Spot, Option<&RowCentre>, &Geometry) -> Answer + Sync
{
}

/// A cell's rows in series, and what is amiss with them.
#[derive(Clone, Copy, Debug)]
pub struct Rows {
    /// The spot and its noise.
    pub cell: Cell,
    /// Counts added to one pixel within three widths of the centre, another in each row.
    pub hot_pixel: Option<f64>,
    /// Pixels of a row.
    pub pixels: usize,
}

impl Rows {
    /// Rows with nothing amiss, so long that the noise is known on them as well as on a sensor's.
    pub fn of(cell: Cell) -> Self {
        Self {
            cell,
            hot_pixel: None,
            pixels: PIXELS,
        }
    }

    /// The true centre in pixels. Series start evenly over 128 pixels and their phases, so that blocks of
    /// every size are met everywhere; their drifts are even too.
    pub fn true_centre(&self, row: u64) -> f64 {
        let series = row / SERIES;
        let [place, drift] = EVEN.map(|step| (series as f64 * step).fract());
        let start = self.pixels as f64 / 2.0 + 128.0 * (place - 0.5);
        start + (row % SERIES) as f64 * FASTEST_DRIFT * (2.0 * drift - 1.0)
    }

    /// A row's counts, light positive, and where its spot is.
    fn row(&self, scene: &Scene, row: u64) -> (Vec<u16>, f64) {
        let centre = self.true_centre(row);
        let mut counts = scene.row_with_centre(row, centre, 1.0);
        if let Some(hot) = self.hot_pixel {
            let place = (row as f64 * EVEN[0]).fract() * 6.0 - 3.0;
            let pixel = (centre + place * self.cell.width).round() as usize;
            if let Some(count) = counts.get_mut(pixel) {
                *count += hot as f32;
            }
        }
        (quantise(&counts, 4095), centre)
    }

    /// Runs the estimators over the rows: an outcome for each, in their order.
    pub fn run(&self, estimators: &[Estimator]) -> Vec<Outcome> {
        self.run_by(estimators, centre::centre)
    }

    /// Runs methods other than the firmware's estimators: `find` is [`centre::centre`] for them.
    pub fn run_by<M: Copy + Sync>(&self, methods: &[M], find: impl Find<M>) -> Vec<Outcome> {
        let (scene, gross) = (self.cell.scene_of(self.pixels), self.cell.gross());
        let series: Vec<Vec<Sums>> = (0..self.cell.rows.div_ceil(SERIES))
            .into_par_iter()
            .map(|series| self.run_series(&scene, series, methods, &find, gross))
            .collect();
        let outcome = |i: usize| {
            let mut total = Sums::default();
            series.iter().for_each(|sums| total.add(&sums[i]));
            total.outcome(&self.cell)
        };
        (0..methods.len()).map(outcome).collect()
    }

    fn run_series<M: Copy>(
        &self,
        scene: &Scene,
        series: u64,
        methods: &[M],
        find: &impl Find<M>,
        gross: f64,
    ) -> Vec<Sums> {
        let (geometry, from) = (scene.geometry(), series * SERIES);
        let rows = from..(from + SERIES).min(self.cell.rows);
        let mut sums = vec![Sums::default(); methods.len()];
        let mut before = vec![None; methods.len()];
        for row in rows {
            let (counts, truth) = self.row(scene, row);
            let row = Row::new(&counts, &[], 4095).expect("quantised to 12 bits");
            let spot = spot::find(&row).map(|(spot, _)| spot);
            for ((&method, sums), before) in methods.iter().zip(&mut sums).zip(&mut before) {
                let find = |spot| find(method, &row, &spot, before.as_ref(), &geometry);
                let centre = spot.and_then(find);
                sums.count(centre, truth, gross);
                *before = centre.ok();
            }
        }
        sums
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    centres: u64,
    faults: u64,
    gross: u64,
    /// Of errors, square pixels.
    squares: f64,
    /// Of errors over claimed uncertainties.
    pulls: f64,
}

impl Sums {
    fn count(&mut self, centre: Answer, truth: f64, gross: f64) {
        let Ok(centre) = centre else {
            self.faults += 1;
            return;
        };
        let error = centre.centre.to_f64() - truth;
        self.centres += 1;
        self.gross += u64::from(error.abs() > gross);
        self.squares += error * error;
        self.pulls += (error / centre.uncertainty.to_f64()).powi(2);
    }

    fn add(&mut self, other: &Self) {
        self.centres += other.centres;
        self.faults += other.faults;
        self.gross += other.gross;
        self.squares += other.squares;
        self.pulls += other.pulls;
    }

    /// Not a number where no row has a centre.
    fn outcome(&self, cell: &Cell) -> Outcome {
        let n = self.centres as f64;
        Outcome {
            rmse: (self.squares / n).sqrt(),
            bound: cell.spot().bound(),
            pull: (self.pulls / n).sqrt(),
            faults: self.faults,
            gross: self.gross,
        }
    }
}

/// Where the bias is looked for. Rounding to counts makes an error of its own, which is averaged away over
/// black levels that differ by fractions of a count: of it 1 / `black_levels` is left.
#[derive(Clone, Copy, Debug)]
pub struct Phases {
    /// Of a row.
    pub pixels: usize,
    /// Places of the spot over a pixel.
    pub phases: u32,
    /// Black levels over a count.
    pub black_levels: u32,
}

impl Phases {
    /// In steps of a fortieth of a pixel.
    pub const fn of(pixels: usize) -> Self {
        Self {
            pixels,
            phases: 40,
            black_levels: 64,
        }
    }

    /// The mean errors over the sub-pixel phases, in pixels, of the centres that a function finds on
    /// noiseless spots of 3800 counts whose profile is given over the offset from their centre: without
    /// knowledge of the row before, and with it.
    ///
    /// # Errors
    /// That of a row without a centre.
    pub fn bias(
        &self,
        profile: impl Fn(f64) -> f64,
        centre: impl Fn(&[u16], Option<&RowCentre>) -> Answer + Sync,
    ) -> Result<[Vec<f64>; 2], Fault> {
        let Self {
            pixels,
            phases,
            black_levels,
        } = *self;
        let truth = |phase| (pixels / 2) as f64 + f64::from(phase) / f64::from(phases) - 0.5;
        let light = |phase| {
            let light = |i: usize| 3800.0 * profile(i as f64 - truth(phase));
            (0..pixels).map(light).collect()
        };
        let light: Vec<Vec<f64>> = (0..phases).map(light).collect();
        // For each black level the errors over the phases, without the row before and with.
        let errors: Vec<[Vec<f64>; 2]> = (0..black_levels)
            .into_par_iter()
            .map(|level| {
                let black = 100.0 + f64::from(level) / f64::from(black_levels);
                let mut errors = [vec![], vec![]];
                let mut last = None;
                for (phase, light) in (0..phases).zip(&light) {
                    let counts = light.iter().map(|light| (black + light) as f32);
                    let counts = quantise(&counts.collect::<Vec<_>>(), 4095);
                    let alone = centre(&counts, None)?;
                    let known = centre(&counts, last.as_ref())?;
                    for (centre, errors) in [alone, known].iter().zip(&mut errors) {
                        errors.push(centre.centre.to_f64() - truth(phase));
                    }
                    last = Some(alone);
                }
                Ok(errors)
            })
            .collect::<Result<_, Fault>>()?;
        let mean = |known: usize, phase: usize| {
            let sum: f64 = errors.iter().map(|errors| errors[known][phase]).sum();
            sum / f64::from(black_levels)
        };
        Ok([0, 1].map(|known| (0..phases as usize).map(|i| mean(known, i)).collect()))
    }
}

/// The largest of some errors.
pub fn largest(errors: &[f64]) -> f64 {
    errors.iter().fold(0.0, |most, error| error.abs().max(most))
}

/// The estimator's largest bias in pixels over the sub-pixel phases, on noiseless gaussian spots, with and
/// without knowledge of the row before, for a sensor with shot noise (10 electrons a count) and for one
/// without. `None` where a row has no centre. What is left of rounding is 3e-5 pixel for the widest spots.
pub fn largest_bias<M: Copy + Sync>(method: M, find: impl Find<M>, width: f64) -> Option<f64> {
    let of_sensor = |electrons_per_count| {
        let cell = Cell {
            electrons_per_count,
            ..Cell::noiseless(width, 3800.0)
        };
        let geometry = cell.scene().geometry();
        let phases = Phases {
            pixels: geometry.words,
            phases: 64,
            black_levels: 16,
        };
        let centre = |light: &[u16], before: Option<&RowCentre>| {
            let row = Row::new(light, &[], 4095).expect("quantised to 12 bits");
            find(method, &row, &spot::find(&row)?.0, before, &geometry)
        };
        let errors = phases.bias(|offset| gaussian(offset, width), centre);
        Some(largest(&errors.ok()?.concat()))
    };
    Some(of_sensor(None)?.max(of_sensor(Some(10.0))?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use simulator::with;

    fn rows() -> Rows {
        Rows::of(Cell {
            width: 4.6,
            amplitude: 2000.0,
            read_noise: 20.0,
            electrons_per_count: None,
            rows: 4000,
            seed: 5,
        })
    }

    /// Measures the same spot with `Cell::run`, which takes each row by itself and draws other places. 4000
    /// rows give the ratio to 1.1 %, so two ratios differ by less than 5 % with three standard deviations to
    /// spare.
    #[test]
    fn series_of_rows_agree_with_single_rows() {
        let cell = rows().cell;
        let alone = cell.run(cell.pixels(), |geometry, light| {
            centre_of(geometry, light, Estimator::PhaseTable)
        });
        let outcomes = rows().run(&[Estimator::PhaseTable]);
        assert_eq!(outcomes.len(), 1);
        let outcome = outcomes[0];
        println!("alone {} here {}", alone.ratio(), outcome.ratio());
        assert_eq!((outcome.faults, outcome.gross), (0, 0));
        assert!((outcome.ratio() / alone.ratio() - 1.0).abs() < 0.05);
        assert!((outcome.bound - alone.bound).abs() < 1e-12);
    }

    #[test]
    fn true_centres_are_even_over_the_phases_and_far_from_the_edges() {
        let rows = rows();
        let mut tenths = [0; 10];
        for row in 0..16_000 {
            let centre = rows.true_centre(row);
            let off = centre - PIXELS as f64 / 2.0;
            assert!(off.abs() <= 64.0 + 0.6 * 15.0, "{centre}");
            tenths[(centre.fract() * 10.0) as usize] += 1;
        }
        println!("{tenths:?}");
        // Even to a few of 1600.
        assert!(tenths.iter().all(|n| (1500..1700).contains(n)));
    }

    /// The hot pixel adds 1000 counts at one width from the centre of a spot of 2000 counts. It moves a
    /// matched fit by about 0.3 pixel. The bound is 0.023 pixel.
    #[test]
    fn a_hot_pixel_increases_the_error_of_a_matched_fit() {
        let spoiled = with(rows(), |it| it.hot_pixel = Some(1000.0));
        let [clean, hot] = [rows(), spoiled].map(|rows| rows.run(&[Estimator::PhaseTable])[0]);
        println!("clean {} hot {}", clean.ratio(), hot.ratio());
        assert!(hot.ratio() > 3.0 * clean.ratio());
    }
}
