//! What several topics write their rows and scenes with, and the names that most of them use.

pub use judges::accuracy::{
    self, Answer, Cell, PIXELS, centre_after, centre_of, centre_with, largest,
};
pub use judges::core_tables;
pub use judges::frames::{self, at_centre, words};
pub use judges::hard_cases::flaw::{Bad, Flaw, Second};
pub use judges::hard_cases::judge::Said;
pub use judges::hard_cases::recipe::Recipe;
pub use judges::hard_cases::{HardRow, Truth, mixtures};
pub use phase_tables::gaussian;
pub use proptest::prelude::*;
pub use rand::{Rng as _, SeedableRng as _};
pub use rand_chacha::ChaCha8Rng;
pub use rand_distr::{Distribution as _, StandardNormal};
pub use rayon::prelude::*;
pub use simulator::least_squares;
pub use simulator::optics::{Aperture, Optics};
pub use simulator::profiles::{self, Curve, Slit};
pub use simulator::scene::{Effect, Scene, SecondReflection, Sensor, Simulation, quantise};
pub use simulator::with;
pub use slitrange::base::exposure::Exposure;
pub use slitrange::base::places::PLACES;
pub use slitrange::base::units::Electrons;
pub use slitrange::base::work_budget::WorkBudget;
pub use slitrange::centre::spot_shape::{COMPONENTS, SpotShape};
pub use slitrange::centre::tables::{BLOCKS, TableSet};
pub use slitrange::centre::{self, half_width};
pub use slitrange::check::own_spot::Profile;
pub use slitrange::distance::eq1::{Eq1, NOMINAL};
pub use slitrange::distance::knots::{CLOSEST, Knot, Knots, MAX_KNOTS};
pub use slitrange::distance::residuals::{Corrected, CorrectedError};
pub use slitrange::distance::table::Table;
pub use slitrange::frame::comb::{Comb, Combined, FEWEST, MAX_SLITS, SlitCentre, SlitMap, Slits};
pub use slitrange::frame::{Frame, FrameCentre, Mean};
pub use slitrange::measurement::centre_of_spot;
pub use slitrange::reading::uncertainty::{FittedErrors, FittedSurface, Parts};
pub use slitrange::row::front_end::{Estimate, FrontEnd};
pub use slitrange::row::pixels::PixelErrors;
pub use slitrange::row::pixels::flat_field::{TakeError, Taken};
pub use slitrange::row::sensor_heads::tcd1304dg;
pub use slitrange::spot::region::Region;
pub use slitrange::spot::{self, Spot};
pub use slitrange::{
    BlackLevel, Calibration, CalibrationErrors, Counts, Estimator, Fault, Geometry, Measured,
    Measurement, Micrometres, Options, Pixels, Polarity, Reading, Row, RowCentre, Surface,
    sensor_heads,
};
pub use slitrange_device::protocol::command::{Command, parse, parse_in};
pub use slitrange_device::protocol::input::Input;
pub use slitrange_device::protocol::line::ReadingLine;
pub use slitrange_device::protocol::packet::FrameResult;
pub use slitrange_device::protocol::status::{StartCause, Vitals};
pub use slitrange_device::protocol::upload::Step;
pub use slitrange_device::record::date::Date;
pub use slitrange_device::record::encoded::EncodedRecord;
pub use slitrange_device::record::{self, Record, RecordError};
pub use slitrange_device::session::flat::Outcome;
pub use slitrange_device::session::{Actions, Event, Session};
pub use slitrange_device::settings::{Setting, Settings};
pub use slitrange_device::store::configuration::Configuration;
pub use slitrange_device::store::pixel_map::StoredMap;
pub use slitrange_device::store::{StoreError, Stored};
pub use statistics::{mean, rms, upper_median};
pub use std::f64::consts::TAU;
use std::io::Write as _;
use std::path::PathBuf;

pub fn random(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

pub fn options(change: impl FnOnce(&mut Options)) -> Options {
    with(Options::default(), change)
}

/// The reading of a frame by the nominal calibration.
pub fn nominal_reading(
    measured: &Measured,
    errors: &CalibrationErrors,
    surface: Surface,
) -> Result<Reading, Fault> {
    measured.reading(Calibration::nominal().as_ref(), errors, surface)
}

/// A knot of a centre in pixels and a value in micrometres.
pub fn knot(centre: i32, um: i32) -> Knot {
    let (centre, value) = (Pixels::from_int(centre), Micrometres::from_int(um));
    Knot { centre, value }
}

pub fn scene(name: &str) -> Scene {
    Scene::load(name).expect("a scene")
}

/// A folder beside the repository, if it is there. Says so if not.
pub fn shared_data(name: &str) -> Option<PathBuf> {
    let shared = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let folder = Some(shared.join(name)).filter(|it| it.is_dir());
    if folder.is_none() {
        // Past the capture of a passing test's output.
        let (mut errors, shared) = (std::io::stderr(), shared.display());
        let _ = writeln!(errors, "SKIPPED: no {name} in {shared}");
    }
    folder
}

/// The scene with the effects of a text ([`Scene::listing`]).
pub fn listing(scene: Scene, effects: &str) -> Scene {
    scene.listing(effects).expect("a scene")
}

/// Read noise in counts, and electrons a count where there is shot noise.
pub type Noise = (f64, Option<f64>);

/// Rows of a spot with a width in pixels and a height in counts.
pub const fn cell(width: f64, amplitude: f64, noise: Noise, rows: u64, seed: u64) -> Cell {
    let (read_noise, electrons_per_count) = noise;
    Cell {
        width,
        amplitude,
        read_noise,
        electrons_per_count,
        rows,
        seed,
    }
}

/// So many pixels of 12 bits, all of them lit, and light positive.
pub fn geometry(pixels: usize, shot_variance_per_count_q16: u16) -> Geometry {
    with(Sensor::Row(pixels).geometry(), |it| {
        it.shot_variance_per_count_q16 = shot_variance_per_count_q16;
    })
}

/// A row's centre and its uncertainty, in pixels.
#[inline]
pub fn row_centre(centre: f64, uncertainty: f64) -> RowCentre {
    RowCentre {
        centre: Pixels::from_bits((centre * 65536.0).round() as i32),
        uncertainty: Pixels::from_bits((uncertainty * 65536.0).round() as i32),
        amplitude: Counts::from_int(1000),
        width: Pixels::from_int(9),
        class: Default::default(),
        shape: Default::default(),
        misfit: false,
    }
}

/// The fault of a comb of which a row shows so many slits.
pub const fn few_slits(found: u16) -> Fault {
    let needed = 4;
    Fault::FewSlits { found, needed }
}

pub fn estimate<T>([value, u]: [T; 2]) -> Estimate<T> {
    Estimate { value, u }
}

pub fn fitted(
    curve: [Micrometres; PLACES],
    deviation: [Micrometres; PLACES],
    height: [Counts; PLACES],
) -> CalibrationErrors {
    let surface = Some(FittedSurface { deviation, height });
    CalibrationErrors::Fitted(FittedErrors { curve, surface })
}

/// How far pixels differ: their response as Q0.16, and their offset in steps.
pub fn pixel_errors(response_q16: u16, offset: i32) -> PixelErrors {
    let offset = Counts::from_bits(offset);
    PixelErrors {
        response_q16,
        offset,
    }
}

/// The parts of an uncertainty, in the order of their list.
pub fn parts(parts: [Micrometres; 7]) -> Parts {
    let [noise, shape, pixels, calibration, surface, geometry, motion] = parts;
    Parts {
        noise,
        shape,
        pixels,
        calibration,
        surface,
        geometry,
        motion,
    }
}

/// A row of 12 bits without shielded pixels.
pub fn row(light: &[u16]) -> Row<'_> {
    Row::new(light, &[], 4095).expect("12 bits")
}

pub fn find(light: &[u16]) -> Result<Spot, Fault> {
    Ok(spot::find(&row(light))?.0)
}

pub fn checked(geometry: &Geometry, light: &[u16], estimator: Estimator) -> Answer {
    checked_after(None, geometry, light, estimator)
}

/// As [`checked`], with what was found in the row before.
pub fn checked_after(
    before: Option<&RowCentre>,
    geometry: &Geometry,
    light: &[u16],
    estimator: Estimator,
) -> Answer {
    let row = Row::new(light, &[], geometry.saturated_from()).expect("12 bits");
    let (spot, budget) = spot::find(&row)?;
    centre_of_spot(estimator, &row, &spot, before, geometry, None, budget)
}

/// All pairs of two lists, in the order of two loops.
pub fn pairs<A: Clone, B>(
    a: impl IntoIterator<Item = A>,
    b: impl IntoIterator<Item = B> + Clone,
) -> impl Iterator<Item = (A, B)> {
    let of = move |a: A| b.clone().into_iter().map(move |b| (a.clone(), b));
    a.into_iter().flat_map(of)
}

/// A row of a sensor with a level of 300 counts, 4 counts of read noise and ten electrons a count.
pub fn noisy_row(random: &mut ChaCha8Rng, pixels: u16, light: impl Fn(f64) -> f64) -> Vec<u16> {
    let counts = (0..pixels).map(|pixel| {
        let light = light(f64::from(pixel));
        let normal: f64 = random.sample(StandardNormal);
        (300.0 + light + (16.0 + light / 10.0).sqrt() * normal) as f32
    });
    quantise(&counts.collect::<Vec<f32>>(), 4095)
}

/// Where a condition that holds from `low` on ceases to hold, up to `high`.
pub fn bisect(mut low: f64, mut high: f64, holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match holds(middle) {
            true => low = middle,
            false => high = middle,
        }
    }
    low
}

pub fn mirrored(light: &[u16]) -> Vec<u16> {
    light.iter().rev().copied().collect()
}

/// Sums over rows of what a function counts in each.
pub fn tally<const N: usize>(rows: u64, count: impl Fn(u64) -> [u64; N] + Send + Sync) -> [u64; N] {
    let add = |a: [u64; N], b: [u64; N]| std::array::from_fn(|i| a[i] + b[i]);
    (0..rows).into_par_iter().map(count).reduce(|| [0; N], add)
}

/// A CRC of a reflected polynomial of up to 32 bits from its definition, bit by bit, inverted at the end.
pub fn reflected_crc(start: u32, polynomial: u32, bytes: &[u8]) -> u32 {
    let shift = |sum: u32, _| (sum >> 1) ^ if sum & 1 == 1 { polynomial } else { 0 };
    let add = |sum: u32, byte: &u8| (0..8).fold(sum ^ u32::from(*byte), shift);
    !bytes.iter().fold(start, add)
}

/// Simpson's rule over twice as many steps.
pub fn integral(from: f64, to: f64, steps: usize, value: impl Fn(f64) -> f64) -> f64 {
    let h = (to - from) / (2 * steps) as f64;
    let weight = |i| match i {
        0 => 1.0,
        _ if i == 2 * steps => 1.0,
        _ => (2 + 2 * (i % 2)) as f64,
    };
    let terms = (0..=2 * steps).map(|i| weight(i) * value(from + h * i as f64));
    terms.sum::<f64>() * h / 3.0
}
