//! Every estimator on the same seeded rows: a cell's rows are made once and all estimators see them.
//!
//! Rows come as the firmware reads them: in series of [`SERIES`] rows of one spot, with independent noise, in which the spot
//! drifts. Each estimator is given what itself found in the row before, except in a series' first row.

use phase_tables::gaussian;
use rayon::prelude::*;
use slitrange::centre::{self, Estimator, RowCentre};
use slitrange::fault::Fault;
use slitrange::row::{Geometry, Row};
use slitrange::spot::{self, Spot};

use crate::accuracy::{Cell, Outcome, PIXELS};
use simulator::bound;
use simulator::scene::{Scene, quantise};

/// Rows in a series.
pub const SERIES: u64 = 16;

/// The spot drifts by up to this many pixels a row, either way: 30 mm/s of a target at 0.8 m and 175 rows a second.
const FASTEST_DRIFT: f64 = 0.6;

/// Additive recurrence over two dimensions, the most even there is: 1/p and 1/p^2 of the plastic number p, p^3 = p + 1.
const EVEN: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_2];

/// A cell's rows, and what is amiss with them.
#[derive(Clone, Copy, Debug)]
pub struct Rows {
    /// The spot and its noise.
    pub cell: Cell,
    /// Counts added to one pixel within three widths of the centre, another in each row.
    pub hot_pixel: Option<f64>,
    /// Pixels of a row.
    pub pixels: usize,
}

/// A function that finds centres as [`centre::centre`] does, by any of several methods `M`.
pub trait Find<M>:
    Fn(M, &Row<'_>, &Spot, Option<&RowCentre>, &Geometry) -> Result<RowCentre, Fault> + Sync
{
}

impl<M, F> Find<M> for F where
    F: Fn(M, &Row<'_>, &Spot, Option<&RowCentre>, &Geometry) -> Result<RowCentre, Fault> + Sync
{
}

/// Whether an estimator is given what it found in the row before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Before {
    /// It is, except in a series' first row.
    Known,
    /// Never.
    Unknown,
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

    /// The Cramér-Rao bound in pixels, of a row with nothing amiss.
    pub fn bound(&self) -> f64 {
        bound::Spot {
            width: self.cell.width,
            amplitude: self.cell.amplitude,
            noise: self.cell.read_noise,
            electrons_per_count: self.cell.electrons_per_count,
        }
        .bound()
    }

    /// The true centre in pixels. Series start evenly over 128 pixels and their phases, so that blocks of every size
    /// are met everywhere; their drifts are even too.
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

    /// Runs the estimators over the rows: an outcome for each, in their order. Every row that has a centre counts, a gross
    /// error as any other.
    pub fn run(&self, estimators: &[Estimator]) -> Vec<Outcome> {
        self.run_by(estimators, centre::centre)
    }

    /// Runs methods other than the firmware's estimators: `find` is [`centre::centre`] for them.
    pub fn run_by<M: Copy + Sync>(&self, methods: &[M], find: impl Find<M>) -> Vec<Outcome> {
        let known = |&method| (method, Before::Known);
        self.run_all(&methods.iter().map(known).collect::<Vec<_>>(), find)
    }

    /// Runs estimators that know the row before, and estimators that do not.
    pub fn run_each(&self, estimators: &[(Estimator, Before)]) -> Vec<Outcome> {
        self.run_all(estimators, centre::centre)
    }

    fn run_all<M: Copy + Sync>(&self, methods: &[(M, Before)], find: impl Find<M>) -> Vec<Outcome> {
        let bound = self.bound();
        let gross = (0.5 * self.cell.width).max(8.0 * bound);
        let scene = self.cell.scene_of(self.pixels);
        // Collected in order before they are added up: the sums are then the same on any number of cores.
        let series: Vec<Vec<Sums>> = (0..self.cell.rows.div_ceil(SERIES))
            .into_par_iter()
            .map(|series| self.run_series(&scene, series, methods, &find, gross))
            .collect();
        (0..methods.len())
            .map(|i| {
                let mut total = Sums::default();
                for sums in &series {
                    total.add(&sums[i]);
                }
                total.outcome(bound)
            })
            .collect()
    }

    fn run_series<M: Copy>(
        &self,
        scene: &Scene,
        series: u64,
        methods: &[(M, Before)],
        find: &impl Find<M>,
        gross: f64,
    ) -> Vec<Sums> {
        let from = series * SERIES;
        let rows = from..(from + SERIES).min(self.cell.rows);
        let mut sums = vec![Sums::default(); methods.len()];
        let mut before = vec![None; methods.len()];
        for row in rows {
            let (counts, truth) = self.row(scene, row);
            let row = Row::new(&counts, &[], 4095).expect("quantised to 12 bits");
            let spot = spot::find(&row);
            for ((&(method, knows), sums), before) in methods.iter().zip(&mut sums).zip(&mut before)
            {
                let centre = spot
                    .and_then(|spot| find(method, &row, &spot, before.as_ref(), &scene.geometry()));
                sums.count(centre, truth, gross);
                *before = centre.ok().filter(|_| knows == Before::Known);
            }
        }
        sums
    }
}

/// What adds up over rows.
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
    fn count(&mut self, centre: Result<RowCentre, Fault>, truth: f64, gross: f64) {
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
    fn outcome(&self, bound: f64) -> Outcome {
        let n = self.centres as f64;
        Outcome {
            rmse: (self.squares / n).sqrt(),
            bound,
            pull: (self.pulls / n).sqrt(),
            faults: self.faults,
            gross: self.gross,
        }
    }
}

/// Phases over a pixel at which the bias is looked for.
const PHASES: u32 = 64;

/// Rounding to counts makes an error of its own; it is averaged away over this many black levels, which differ by
/// fractions of a count. What is left of it is a sixteenth: 3e-5 pixel for the widest spots.
const DITHERS: u32 = 16;

/// The method's largest bias in pixels over the sub-pixel phases, on noiseless gaussian spots of 3800 counts, with and without
/// knowledge of the row before, for a sensor with shot noise (10 electrons a count) and for one without. `None` where a row
/// has no centre.
pub fn largest_bias<M: Copy + Sync>(method: M, find: impl Find<M>, width: f64) -> Option<f64> {
    let shots = [None, Some(10.0)];
    shots
        .into_iter()
        .map(|electrons_per_count| {
            let cell = Cell {
                width,
                amplitude: 3800.0,
                read_noise: 0.0,
                electrons_per_count,
                rows: 0,
                seed: 0,
            };
            bias(method, &find, width, &cell.scene().geometry())
        })
        .try_fold(0.0f64, |worst, bias| Some(worst.max(bias?)))
}

fn bias<M: Copy + Sync>(
    method: M,
    find: &impl Find<M>,
    width: f64,
    geometry: &Geometry,
) -> Option<f64> {
    let truth = |phase| (geometry.words / 2) as f64 + f64::from(phase) / f64::from(PHASES) - 0.5;
    // For each black level the errors over the phases, with the row before and without.
    let errors: Vec<[Vec<f64>; 2]> = (0..DITHERS)
        .into_par_iter()
        .map(|dither| {
            let black = 100.0 + f64::from(dither) / f64::from(DITHERS);
            let mut errors = [vec![], vec![]];
            let mut last = None;
            for phase in 0..PHASES {
                let counts: Vec<f32> = (0..geometry.words)
                    .map(|i| (black + 3800.0 * gaussian(i as f64 - truth(phase), width)) as f32)
                    .collect();
                let counts = quantise(&counts, 4095);
                let row = Row::new(&counts, &[], 4095).expect("quantised to 12 bits");
                let spot = spot::find(&row).ok()?;
                let centre = |before| find(method, &row, &spot, before, geometry).ok();
                let alone = centre(None)?;
                let known = centre(last.as_ref())?;
                for (centre, errors) in [alone, known].iter().zip(&mut errors) {
                    errors.push(centre.centre.to_f64() - truth(phase));
                }
                last = Some(alone);
            }
            Some(errors)
        })
        .collect::<Option<_>>()?;
    let mean = |known: usize, phase: usize| {
        errors
            .iter()
            .map(|errors| errors[known][phase])
            .sum::<f64>()
            / f64::from(DITHERS)
    };
    Some(
        (0..2)
            .flat_map(|known| (0..PHASES as usize).map(move |phase| (known, phase)))
            .map(|(known, phase)| mean(known, phase).abs())
            .fold(0.0, f64::max),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

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

    /// The same spot through `Cell::run`, whose spots stand elsewhere and have no row before: 4000 rows give the
    /// ratio to 1.1 %, so the difference of two is within 5 % with three standard deviations to spare.
    #[test]
    fn agrees_with_the_cell_on_its_own() {
        let alone = rows().cell.run(&slitrange::centre::tables::GAUSSIAN);
        let [outcome] = rows().run(&[Estimator::PhaseTable])[..] else {
            panic!("one estimator, one outcome");
        };
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
            assert!(
                (centre - PIXELS as f64 / 2.0).abs() <= 64.0 + 0.6 * 15.0,
                "{centre}"
            );
            tenths[(centre.fract() * 10.0) as usize] += 1;
        }
        println!("{tenths:?}");
        // Even to a few of 1600.
        assert!(tenths.iter().all(|n| (1500..1700).contains(n)));
    }

    /// A hot pixel is there, and hurts an estimator that does not look for it: 1000 counts at one width from the centre of a spot
    /// of 2000 move a matched fit by about 0.3 pixel, where the bound is 0.023.
    #[test]
    fn a_hot_pixel_is_seen() {
        let spoiled = Rows {
            hot_pixel: Some(1000.0),
            ..rows()
        };
        let [clean, hot] = [rows(), spoiled].map(|rows| rows.run(&[Estimator::PhaseTable])[0]);
        println!("clean {} hot {}", clean.ratio(), hot.ratio());
        assert!(hot.ratio() > 3.0 * clean.ratio());
    }
}
