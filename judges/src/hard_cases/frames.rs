//! Frames that are hard: rows that disagree, hang together, or are not there.

use crate::frames::measure_rows;
use crate::hard_cases::flaw::{Flaw, Second};
use crate::hard_cases::judge::{Outcome, Said};
use crate::hard_cases::recipe::{Place, Recipe};
use crate::hard_cases::{Due, Truth};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, Exp1, StandardNormal};
use simulator::optics::Optics;
use simulator::scene::{LaserSpot, Motion, Scene, Sensor, Simulation, Speckle, Spot, quantise};
use simulator::with;
use slitrange::distance::eq1::Eq1;
use slitrange::frame::MAX_ROWS;
use slitrange::{
    BlackLevel, Calibration, CalibrationErrors, Estimator, Fault, Geometry, Mean, Micrometres,
    Options, Pixels, Reading, Surface,
};
use statistics::mean;

/// A frame that is hard in one way.
#[derive(Clone, Copy, Debug)]
pub struct FrameCase {
    /// What it is, in a few words.
    pub name: &'static str,
    /// Why it is hard.
    pub why: &'static str,
    /// What must come out. A reading counts as flagged where most of the rows used are misfits, or where it
    /// says that its rows hang together.
    pub due: Due,
    make: fn(u64) -> HardFrame,
}

/// A frame, and what a perfect reader would say of it.
#[derive(Clone, Debug)]
pub struct HardFrame {
    /// The words of its read-outs.
    pub rows: Vec<Vec<u16>>,
    /// The sensor's.
    pub geometry: Geometry,
    /// Where the spot is, in pixels of the light range.
    pub truth: Truth,
}

/// Frames of each case in the table.
pub const FRAMES: u64 = 4;

/// The width of the frames' spot in pixels.
const WIDTH: f64 = 10.5;
/// Pixels under metal, before those that see light.
const SHIELDED: usize = 16;
const FULL: usize = MAX_ROWS as usize;

/// D = 0, xp = -1000 px, and half a metre in the middle of 512 pixels.
///
/// # Panics
/// Never: the curve is one.
pub fn calibration() -> Eq1 {
    const K: i64 = (500_000.0 * 1256.0 * 65536.0) as i64;
    Eq1::new(
        Micrometres::from_int(0),
        K,
        Pixels::from_int(-1000),
        Pixels::from_int(0)..=Pixels::from_int(1023),
    )
    .expect("xp is far from the range")
}

impl HardFrame {
    /// What the whole measurement makes of it with an estimator.
    pub fn reading(&self, estimator: Estimator) -> Result<Reading, Fault> {
        let options = Options {
            mean: Mean::Weighted,
            estimator,
            black_level: BlackLevel::Shielded,
            ..Options::default()
        };
        let measured = measure_rows(&self.rows, &self.geometry, options, None)?;
        let (calibration, errors) = (Calibration::Eq1(calibration()), CalibrationErrors::Unknown);
        measured.reading(Some(&calibration), &errors, Surface::Off)
    }
}

impl FrameCase {
    /// A frame. Frames differ in their noise, and in where the spot is, to a fraction of a pixel.
    pub fn frame(&self, number: u64) -> HardFrame {
        (self.make)(number)
    }

    /// Runs every estimator over its frames.
    pub fn run(&self) -> Vec<Outcome> {
        let frames: Vec<HardFrame> = (0..FRAMES).map(|number| self.frame(number)).collect();
        let outcome = |estimator| {
            let readings: Vec<_> = frames.iter().map(|it| it.reading(estimator)).collect();
            let said = frames.iter().zip(&readings);
            let said = said.map(|(frame, reading)| Said::of_reading(frame.truth, reading));
            let nonsense = readings.iter().find_map(nonsense);
            Outcome::of(self.due, estimator, said.collect(), nonsense)
        };
        Estimator::ALL.map(outcome).to_vec()
    }
}

/// What no reading may be: an uncertainty of nothing, or a distance that is not that of its centre.
fn nonsense(answer: &Result<Reading, Fault>) -> Option<String> {
    let reading = answer.ok()?;
    let (curve, centre) = (calibration(), reading.centre.to_f64());
    let k = curve.k() as f64 / 65536.0;
    let expected = curve.d().to_f64() + k / (centre - curve.pole().to_f64());
    // Q24.8 micrometres are rounded.
    let is_off = (reading.distance.to_f64() - expected).abs() > 0.01;
    let is_certain =
        reading.uncertainty.to_bits() <= 0 || reading.centre_uncertainty.to_bits() <= 0;
    (is_off || is_certain).then(|| format!("nonsense: {reading:?}"))
}

/// Whether a reading says that it is not to be trusted.
pub fn is_flagged(reading: &Reading) -> bool {
    2 * reading.misfits > reading.rows_used || reading.correlated.is_some()
}

fn middle(number: u64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    240.0 + 32.0 * ((number as f64 + 0.5) * GOLDEN).fract()
}

/// A frame of so many rows, of recipes for the row of a number; shielded pixels read the black level.
fn frame(number: u64, rows: usize, truth: Truth, recipe: impl Fn(u64) -> Recipe) -> HardFrame {
    let recipes: Vec<Recipe> = (0..rows as u64).map(recipe).collect();
    let rows = recipes.iter().zip(0..).map(|(recipe, row)| {
        let level = recipe.black_level.clamp(0.0, 4095.0) as u16;
        [vec![level; SHIELDED], recipe.row(number, row).light].concat()
    });
    let light = recipes.first().map(Recipe::geometry);
    let light = light.expect("a row at least");
    HardFrame {
        rows: rows.collect(),
        geometry: Geometry {
            words: SHIELDED + light.words,
            shielded: 0..SHIELDED,
            light: SHIELDED..SHIELDED + light.words,
            ..light
        },
        truth,
    }
}

fn spot_at(centre: f64) -> Recipe {
    Recipe::clean(WIDTH).spot(|spot| spot.place = Place::At(centre))
}

/// A frame of 64 rows whose spot is moved in the row of a number.
fn moved(number: u64, truth: Truth, by: impl Fn(u64) -> f64) -> HardFrame {
    let centre = middle(number);
    frame(number, FULL, truth, |row| spot_at(centre + by(row)))
}

/// A frame of 64 rows, of which those with these last digits are off by so many pixels.
fn some_off(number: u64, pixels: f64, digits: &[u64]) -> HardFrame {
    let off = |row: u64| f64::from(u8::from(digits.contains(&(row % 10))));
    moved(number, Truth::Centre(middle(number)), |row| {
        pixels * off(row)
    })
}

/// A frame of 64 rows with a clean spot at rest, changed in each row.
fn full(number: u64, recipe: impl Fn(u64, Recipe) -> Recipe) -> HardFrame {
    steady(number, FULL, recipe)
}

fn clean(number: u64) -> HardFrame {
    full(number, |_, recipe| recipe)
}

/// The same with the words of each row changed.
fn spoilt(number: u64, spoil: impl FnMut(&mut Vec<u16>)) -> HardFrame {
    let mut frame = clean(number);
    frame.rows.iter_mut().for_each(spoil);
    frame
}

fn steady(number: u64, rows: usize, recipe: impl Fn(u64, Recipe) -> Recipe) -> HardFrame {
    let centre = middle(number);
    frame(number, rows, Truth::Centre(centre), |row| {
        recipe(row, spot_at(centre))
    })
}

/// The same numbers for a frame and whatever its rows draw.
fn numbers(number: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(!number)
}

/// The cases.
pub fn frames() -> Vec<FrameCase> {
    [
        alone(),
        outliers(),
        changing(),
        broken(),
        hanging_together(),
    ]
    .concat()
}

type Words = &'static str;

const fn case(name: Words, why: Words, due: Due, make: fn(u64) -> HardFrame) -> FrameCase {
    FrameCase {
        name,
        why,
        due,
        make,
    }
}

#[rustfmt::skip] // A case a line or two.
fn alone() -> Vec<FrameCase> {
    vec![
        case("one row", "there is no scatter to compare with", Due::Centre(0.15),
            |number| steady(number, 1, |_, recipe| recipe)),
        case("two rows", "the scatter of two rows says little", Due::Centre(0.15),
            |number| steady(number, 2, |_, recipe| recipe)),
        case("two rows 5 px apart", "nobody can tell which row is right", Due::Honest,
            |number| {
                let centre = middle(number);
                frame(number, 2, Truth::Between(centre, centre + 5.0), |row| {
                    spot_at(centre + 5.0 * row as f64)
                })
            }),
        case("one row of noise", "the row has no spot", Due::Fault(&["no spot", "too dim"]),
            |number| frame(number, 1, Truth::None, |_| Recipe::dark())),
        case("64 rows", "the uncertainty falls with the square root of the number of rows",
            Due::Centre(0.07), clean),
        case("64 rows of noise", "some of the rows seem to have a spot", Due::Fault(&["no spot", "too dim"]),
            |number| frame(number, FULL, Truth::None, |_| Recipe::dark())),
        case("64 times the same row", "the rows have no scatter, but they have an error", Due::Honest,
            |number| {
                let mut frame = steady(number, 1, |_, recipe| recipe);
                frame.rows = vec![frame.rows[0].clone(); FULL];
                frame
            }),
        case("64 rows without noise", "the scatter is zero: only rounding makes an error",
            Due::Honest, |number| {
                full(number, |_, recipe| Recipe {
                    read_noise: 0.0,
                    electrons_per_count: None,
                    ..recipe
                })
            }),
        case("64 rows, all black", "no row has light or noise", Due::Fault(&["sensor silent"]),
            |number| {
                frame(number, FULL, Truth::None, |_| Recipe {
                    read_noise: 0.0,
                    black_level: 0.0,
                    ..Recipe::dark()
                })
            }),
    ]
}

#[rustfmt::skip] // A case a line or two.
fn outliers() -> Vec<FrameCase> {
    vec![
        case("6 of 64 rows are off by 3 px", "a plain mean is off by 0.3 px", Due::Centre(0.07),
            |number| some_off(number, 3.0, &[4])),
        case("6 of 64 rows are off by 100 px",
            "a plain mean is off by 9 px, and the scatter is larger than the spot's width", Due::Honest,
            |number| some_off(number, 100.0, &[4])),
        case("19 of 64 rows are off by 3 px", "nearly a third are wrong", Due::Honest,
            |number| some_off(number, 3.0, &[1, 4, 7])),
        case("half of the rows are off by 3 px", "there is no majority", Due::Honest,
            |number| {
                let centre = middle(number);
                moved(number, Truth::Between(centre, centre + 3.0), |row| {
                    3.0 * (row % 2) as f64
                })
            }),
        case("half of the rows are off by 100 px", "two spots take turns", Due::Fault(&["unsteady"]),
            |number| moved(number, Truth::None, |row| 100.0 * (row % 2) as f64)),
        case("every row is elsewhere", "all rows are outliers", Due::Fault(&["unsteady"]),
            |number| {
                let mut random = numbers(number);
                let places: Vec<f64> = (0..FULL)
                    .map(|_| random.random_range(-150.0..150.0))
                    .collect();
                moved(number, Truth::None, |row| places[row as usize])
            }),
    ]
}

#[rustfmt::skip] // A case a line or two.
fn changing() -> Vec<FrameCase> {
    vec![
        case("heights differ as speckle's do", "dim rows are less certain, and some have no centre",
            Due::Honest, |number| {
                let mut random = numbers(number);
                let heights: Vec<f64> = (0..FULL).map(|_| Exp1.sample(&mut random)).collect();
                full(number, |row, recipe| {
                    recipe.spot(|spot| spot.amplitude = (600.0 * heights[row as usize]).min(3600.0))
                })
            }),
        case("the laser fades away", "the last rows are noise", Due::Honest,
            |number| {
                full(number, |row, recipe| {
                    recipe.spot(|spot| spot.amplitude *= 1.0 - row as f64 / FULL as f64)
                })
            }),
        case("the laser blinks", "half of the rows have no spot", Due::Fault(&["no spot", "too dim"]),
            |number| full(number, |row, recipe| match row % 2 { 0 => recipe, _ => Recipe::dark() })),
        case("33 of 64 rows have a spot", "one row more than half", Due::Honest,
            |number| {
                full(number, |row, recipe| match row % 2 {
                    1 if row > 1 => Recipe::dark(),
                    _ => recipe,
                })
            }),
        case("the black level rises by 10 counts a row", "the row before has another background",
            Due::Centre(0.07),
            |number| full(number, |row, recipe| recipe.on_level(300.0 + 10.0 * row as f64))),
        case("a lamp is switched on", "from one row to the next there are 800 counts more, with more noise",
            Due::Honest, |number| {
                full(number, |row, recipe| match row {
                    0..30 => recipe,
                    _ => with(recipe, |it| (it.black_level, it.read_noise) = (1100.0, 13.0)),
                })
            }),
        case("the shielded pixels read 50 counts too little", "the black level is wrong by 50 counts",
            Due::Centre(0.07), |number| spoilt(number, |row| row[..SHIELDED].fill(250))),
        case("the target moves by a pixel", "the centre drifts through the frame", Due::Honest,
            |number| {
                let centre = middle(number);
                moved(number, Truth::Between(centre, centre + 1.0), |row| {
                    row as f64 / FULL as f64
                })
            }),
        case("the target moves by 60 pixels", "it moves by more than the spot's width",
            Due::Fault(&["unsteady"]),
            |number| moved(number, Truth::None, |row| 60.0 * row as f64 / FULL as f64)),
        case("half of the rows saturate", "the light flickers beyond full scale", Due::Honest,
            |number| {
                full(number, |row, recipe| {
                    recipe.spot(|spot| spot.amplitude = [2000.0, 6000.0][row as usize % 2])
                })
            }),
        case("two spots in every row", "all rows agree, but no row can tell which spot is the laser's",
            Due::NoCentre,
            |number| {
                let (centre, second) = (middle(number), Flaw::Second(Second::new(1.0, 8.0, 1.0)));
                frame(number, FULL, Truth::None, |_| spot_at(centre).with(second))
            }),
        case("a slope of 2 counts a pixel in every row", "all rows agree, but all have the same error",
            Due::Honest, |number| {
                full(number, |_, recipe| {
                    let spot = recipe.spot(|spot| spot.amplitude = 1200.0);
                    spot.on_level(60.0).with(Flaw::Slope(2.0))
                })
            }),
    ]
}

#[rustfmt::skip] // A case a line or two.
fn broken() -> Vec<FrameCase> {
    vec![
        case("every row is a word short", "the sensor lost a clock", Due::Fault(&["sensor silent"]),
            |number| spoilt(number, |row| row.truncate(SHIELDED + 511))),
        case("every row is empty", "no words arrived", Due::Fault(&["sensor silent"]),
            |number| spoilt(number, Vec::clear)),
        case("words of 16 bits", "an open wire gives words that no 12-bit converter gives",
            Due::Fault(&["sensor silent"]),
            |number| spoilt(number, |row| row.iter_mut().for_each(|word| *word |= 0x8000))),
        case("6 of 64 rows are broken", "the others are good", Due::Centre(0.07),
            |number| {
                let mut frame = clean(number);
                for row in frame.rows.iter_mut().skip(3).step_by(10) {
                    row.iter_mut().for_each(|word| *word = 0xffff);
                }
                frame
            }),
    ]
}

#[rustfmt::skip] // A case a line or two.
fn hanging_together() -> Vec<FrameCase> {
    vec![
        case("a jitter of 0.3 px that lasts 16 rows", "64 rows tell no more than two independent rows",
            Due::Honest,
            |number| jittering(number, 16.0)),
        case("a jitter of 0.3 px that lasts 64 rows",
            "the jitter is slower than the frame, so the frame sees little of it", Due::Honest,
            |number| jittering(number, 64.0)),
        case("speckle, the target moves away at 5 mm/s", "the pattern changes once or twice in a frame",
            Due::Honest, |number| speckled(number, 0.005, 0.0)),
        case("speckle, the target slides past at 5 mm/s", "it changes once or twice in a frame", Due::Honest,
            |number| speckled(number, 1e-4, 50.0)),
        case("speckle, the target slides past at 20 mm/s", "the pattern changes every ten rows", Due::Honest,
            |number| speckled(number, 1e-4, 200.0)),
        case("speckle, the target at rest",
            "all rows see the same pattern: the spot is moved, and looks normal",
            Due::Unknowable, |number| speckled(number, 0.0, 0.0)),
    ]
}

/// A frame whose rows are off by 0.3 pixels root mean square, and forget where they were over so many rows
/// (an autoregressive series of first order).
fn jittering(number: u64, rows: f64) -> HardFrame {
    let (mut random, deviation) = (numbers(number), 0.3);
    let kept = (-1.0 / rows).exp();
    let fresh = deviation * (1.0 - kept * kept).sqrt();
    let first: f64 = StandardNormal.sample(&mut random);
    let mut place = deviation * first;
    let jitter = (0..FULL).map(|_| {
        let normal: f64 = StandardNormal.sample(&mut random);
        place = kept * place + fresh * normal;
        place
    });
    let jitter: Vec<f64> = jitter.collect();
    moved(number, Truth::Centre(middle(number)), |row| {
        jitter[row as usize]
    })
}

/// White paper and a laser spot of 1 mm (a surface of speckle repeats after 8 mm, further than any of these
/// goes), moving away at so many metres a second, and sliding so many metres for each.
fn speckled(number: u64, speed: f64, wander: f64) -> HardFrame {
    let sensor = Sensor::Row(1024);
    let scene = Scene {
        seed: number,
        optics: Optics::nominal_on(sensor),
        sensor,
        spot: Some(Spot::new(8.6, 175e3)),
        laser_spot: Some(with(LaserSpot::new(1e-3, 0.8), |it| it.wander = wander)),
        speckle: Some(Speckle::of_one_wavelength(2)),
        motion: Some(Motion { speed }),
        ..Scene::white_paper()
    };
    let (distance, exposure) = (scene.distance, 0.0057);
    let simulation = Simulation::new(scene);
    let rows = (0..FULL as u64)
        .map(|row| quantise(&simulation.row(row, distance, exposure), 4095))
        .collect();
    // What a reading of a moving target is to be compared with.
    let mean = mean((0..FULL as u64).map(|row| simulation.true_centre(row, distance)));
    HardFrame {
        rows,
        geometry: simulation.scene().geometry(),
        truth: Truth::Centre(mean),
    }
}
