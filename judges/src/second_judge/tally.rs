//! What the firmware makes of the rows and frames, counted.

use crate::frames::measure_rows;
use crate::second_judge::{Claim, Frame, Kind, frame, row};
use rayon::prelude::*;
use simulator::with;
use slitrange::base::places::PLACES;
use slitrange::check::own_spot::Profile;
use slitrange::frame::FrameCentre;
use slitrange::{Estimator, Fault, Measured, Options, Pixels};

/// A sensor that is judged.
#[derive(Clone, Copy, Debug)]
pub struct Judged {
    /// How it finds centres.
    pub estimator: Estimator,
    /// Whether a calibration learned its own spot.
    pub is_calibrated: bool,
}

impl Judged {
    const fn new(estimator: Estimator, is_calibrated: bool) -> Self {
        Self {
            estimator,
            is_calibrated,
        }
    }
}

/// The sensors judged: calibrated, with the default estimator and `phase-table`; and never calibrated.
pub const JUDGED: [Judged; 3] = [
    Judged::new(Estimator::Adaptive, true),
    Judged::new(Estimator::PhaseTable, true),
    Judged::new(Estimator::Adaptive, false),
];

/// A confident error is larger than so many claimed standard uncertainties ...
const CLAIMS: f64 = 5.0;
/// ... and than so many pixels.
const SLACK: f64 = 0.1;
/// How well a calibration knows the widths of its spots, as a share.
const WIDTH_DEVIATION: f32 = 0.003;

/// What comes of a frame, or of a row that is a frame of its own.
#[derive(Clone, Copy, Debug)]
pub enum Verdict {
    /// No centre.
    Fault(Fault),
    /// A centre.
    Centre {
        /// How far it is off, in pixels; infinitely, if any centre is wrong.
        error: f64,
        /// Its claimed standard uncertainty in pixels.
        claim: f64,
        /// Whether the reading has a flag.
        is_flagged: bool,
        /// Rows that do not look like their spot.
        misfits: u16,
    },
}

impl Frame {
    /// Runs the firmware's pipeline with an estimator, on a sensor that knows its own spot or does not.
    ///
    /// # Errors
    /// The fault that the firmware reports.
    pub fn measure(
        &self,
        estimator: Estimator,
        profile: Option<Profile>,
    ) -> Result<Measured, Fault> {
        measure_rows(&self.rows, &self.geometry, options(estimator), profile)
    }

    /// The sensor's own spot, from the rows that a calibration sees.
    pub fn profile(&self, estimator: Estimator) -> Option<Profile> {
        let seen = measure_rows(&self.calibration, &self.geometry, options(estimator), None);
        let seen = seen.ok()?.frame;
        Some(Profile {
            first: Pixels::default(),
            last: Pixels::from_int(self.geometry.light.len() as i32),
            width: [seen.shape.width; PLACES],
            width_deviation: Pixels::from_f32(WIDTH_DEVIATION * seen.shape.width.to_f32()),
            components: seen.shape.components.map(|component| [component; PLACES]),
            deviation: seen.shape.noise,
        })
    }

    /// What comes of it.
    pub fn verdict(&self, kind: &Kind, judged: Judged) -> Verdict {
        let Judged {
            estimator,
            is_calibrated,
        } = judged;
        let profile = is_calibrated.then(|| self.profile(estimator)).flatten();
        let measured = match self.measure(estimator, profile) {
            Ok(measured) => measured,
            Err(fault) => return Verdict::Fault(fault),
        };
        let found = measured.frame;
        let (width, height, pixels) = (found.width, found.amplitude, measured.pixels);
        let pixels = match kind.claim {
            Claim::Centre => 0.0,
            Claim::CentreAndPixels => pixels
                .of_centre(estimator, width, height, measured.ambient)
                .into(),
        };
        Verdict::Centre {
            error: self.truth.error(found.centre.to_f64()),
            claim: (found.uncertainty.to_f64())
                .hypot(measured.by_shape.to_f64())
                .hypot(found.motion.to_f64())
                .hypot(pixels),
            is_flagged: is_flagged(&found),
            misfits: found.misfits,
        }
    }
}

fn options(estimator: Estimator) -> Options {
    with(Options::default(), |it| it.estimator = estimator)
}

/// Whether a reading of this centre says that it is not to be trusted: most of its rows do not look like
/// their spot, or its rows have similar errors.
fn is_flagged(found: &FrameCentre) -> bool {
    2 * found.misfits > found.rows_used || found.correlated.is_some()
}

impl Verdict {
    /// Whether it is a centre with a flag.
    pub const fn is_flagged(&self) -> bool {
        matches!(self, Self::Centre { is_flagged, .. } if *is_flagged)
    }

    /// Whether it is a centre that is further off than it claims.
    pub fn is_beyond_claim(&self) -> bool {
        matches!(self, Self::Centre { error, claim, .. } if error.abs() > SLACK.max(CLAIMS * claim))
    }

    /// Whether it is wrong, and does not say so.
    pub fn is_confident_error(&self) -> bool {
        self.is_beyond_claim() && !self.is_flagged()
    }
}

/// Numbers of rows or frames that are kept, to tell their stories.
const NUMBERS: usize = 8;

/// What came of many rows or frames.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    /// Rows or frames.
    pub count: u64,
    /// Faults.
    pub faults: u64,
    /// Centres with a flag.
    pub flagged: u64,
    /// Of those, the centres that are as good as they claim.
    pub flagged_good: u64,
    /// Confident errors.
    pub errors: u64,
    /// The largest confident error in pixels; infinite, if a centre came where there is none.
    pub largest: f64,
    /// Centres without a flag, and the sum of the squares of their errors over their claims.
    pub sure: (u64, f64),
    /// Numbers of the first confident errors.
    pub numbers: Vec<u64>,
}

impl Tally {
    fn of(number: u64, verdict: Verdict) -> Self {
        let one = |is: bool| u64::from(is);
        let is_wrong = verdict.is_confident_error();
        let mut tally = Self {
            count: 1,
            faults: one(matches!(verdict, Verdict::Fault(_))),
            flagged: one(verdict.is_flagged()),
            flagged_good: one(verdict.is_flagged() && !verdict.is_beyond_claim()),
            errors: one(is_wrong),
            ..Self::default()
        };
        if let Verdict::Centre {
            error,
            claim,
            is_flagged,
            ..
        } = verdict
        {
            if is_wrong {
                tally.largest = error.abs();
                tally.numbers = vec![number];
            }
            if !is_flagged && error.is_finite() {
                tally.sure = (1, (error / claim).powi(2));
            }
        }
        tally
    }

    fn add(mut self, other: Self) -> Self {
        self.count += other.count;
        self.faults += other.faults;
        self.flagged += other.flagged;
        self.flagged_good += other.flagged_good;
        self.errors += other.errors;
        self.largest = self.largest.max(other.largest);
        self.sure.0 += other.sure.0;
        self.sure.1 += other.sure.1;
        self.numbers.extend(other.numbers);
        self.numbers.sort_unstable();
        self.numbers.truncate(NUMBERS);
        self
    }

    /// A count as a share of all.
    pub fn share(&self, count: u64) -> f64 {
        count as f64 / self.count.max(1) as f64
    }

    /// Errors over claims of the centres without a flag, root mean square: 1 if the claims are right.
    pub fn error_over_claim(&self) -> f64 {
        (self.sure.1 / self.sure.0.max(1) as f64).sqrt()
    }
}

/// What came of a kind, with each of [`JUDGED`].
#[derive(Clone)]
pub struct KindReport {
    /// The kind.
    pub kind: &'static Kind,
    /// Of its rows.
    pub rows: [Tally; JUDGED.len()],
    /// Of its frames.
    pub frames: [Tally; JUDGED.len()],
}

/// What came of all kinds.
#[derive(Clone)]
pub struct Report {
    /// Each kind, in the order of [`Kind::all`].
    pub kinds: Vec<KindReport>,
}

/// Judges so many rows and frames of each of these kinds.
pub fn judge(kinds: &'static [Kind], rows: u64, frames: u64) -> Report {
    judge_with(kinds, rows, frames, &|| {})
}

/// As [`judge`]. Calls `done` after each row and each frame.
pub fn judge_with(
    kinds: &'static [Kind],
    rows: u64,
    frames: u64,
    done: &(impl Fn() + Sync),
) -> Report {
    let kinds = kinds.iter().map(|kind| KindReport {
        kind,
        rows: tally(kind, JUDGED, rows, row, done),
        frames: tally(kind, JUDGED, frames, frame, done),
    });
    Report {
        kinds: kinds.collect(),
    }
}

/// Judges so many frames of a kind, with the first of [`JUDGED`] alone.
pub fn judge_frames(kind: &Kind, frames: u64) -> Tally {
    let [tally] = tally(kind, [JUDGED[0]], frames, frame, &|| {});
    tally
}

fn tally<const N: usize>(
    kind: &Kind,
    judged: [Judged; N],
    count: u64,
    take: fn(&Kind, u64) -> Frame,
    done: &(impl Fn() + Sync),
) -> [Tally; N] {
    let none = || std::array::from_fn(|_| Tally::default());
    let add = |mut sums: [Tally; N], more: [Tally; N]| {
        for (sum, more) in sums.iter_mut().zip(more) {
            *sum = std::mem::take(sum).add(more);
        }
        sums
    };
    (0..count)
        .into_par_iter()
        .fold(none, |tallies, number| {
            let frame = take(kind, number);
            done();
            let tally = |judged| Tally::of(number, frame.verdict(kind, judged));
            add(tallies, judged.map(tally))
        })
        .reduce(none, add)
}
