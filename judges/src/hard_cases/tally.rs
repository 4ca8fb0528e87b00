//! How often centres are wrong without saying so, over many random rows.

use crate::hard_cases::Truth;
use crate::hard_cases::judge::{Answer, Said, answers};
use crate::hard_cases::mixtures::{Kind, RandomRow};
use rayon::prelude::*;
use simulator::with;
use slitrange::centre::Estimator;

const ESTIMATORS: usize = Estimator::ALL.len();

/// What came of many rows for an estimator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Centres off by more than they claim, without a flag.
    pub confident_errors: u64,
    /// Centres with a flag.
    pub flagged: u64,
    /// Of those, the centres that were as good as they claim.
    pub flagged_good: u64,
    /// Faults.
    pub faults: u64,
}

impl Counts {
    fn of(truth: Truth, answer: &Answer) -> Self {
        let one = |is: bool| u64::from(is);
        let said = Said::of_row(truth, answer);
        Self {
            confident_errors: one(said.is_confident_error()),
            flagged: one(said.is_flagged()),
            flagged_good: one(said.is_flagged() && said.is_as_claimed()),
            faults: one(answer.is_err()),
        }
    }

    fn add(&mut self, other: Self) {
        self.confident_errors += other.confident_errors;
        self.flagged += other.flagged;
        self.flagged_good += other.flagged_good;
        self.faults += other.faults;
    }
}

/// The default estimator's confident errors in the rows with a kind of flaw.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OfKind {
    /// Rows.
    pub rows: u64,
    /// Errors as the measurement takes the estimator.
    pub checked: u64,
    /// Errors of the estimator alone.
    pub alone: u64,
}

/// What came of many rows.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    /// Rows.
    pub rows: u64,
    /// Of each estimator as the measurement takes it, in the order of [`Estimator::ALL`].
    pub checked: [Counts; ESTIMATORS],
    /// Of each estimator alone.
    pub alone: [Counts; ESTIMATORS],
    /// Of each kind of flaw: the rows that have it, and the default estimator's errors in them.
    pub kinds: [OfKind; Kind::ALL.len()],
    /// The first seeds of rows in which the default estimator in the measurement was confidently wrong.
    pub seeds: Vec<u64>,
}

const SEEDS: usize = 24;

impl Tally {
    fn of(random_row: &RandomRow) -> Self {
        let row = random_row.row();
        let mut tally = with(Self::default(), |it| it.rows = 1);
        for (i, answers) in answers(&row).iter().enumerate() {
            tally.checked[i] = Counts::of(row.truth, &answers.checked);
            tally.alone[i] = Counts::of(row.truth, &answers.alone);
            if Estimator::ALL[i] != Estimator::default() {
                continue;
            }
            let [checked, alone] =
                [tally.checked[i], tally.alone[i]].map(|counts| counts.confident_errors);
            if checked > 0 {
                tally.seeds.push(random_row.seed);
            }
            for kind in &random_row.kinds {
                let of_kind = &mut tally.kinds[*kind as usize];
                (of_kind.rows, of_kind.checked, of_kind.alone) = (1, checked, alone);
            }
        }
        tally
    }

    fn add(mut self, other: Self) -> Self {
        self.rows += other.rows;
        let all = self.checked.iter_mut().chain(&mut self.alone);
        for (counts, other) in all.zip(other.checked.into_iter().chain(other.alone)) {
            counts.add(other);
        }
        for (of_kind, other) in self.kinds.iter_mut().zip(other.kinds) {
            of_kind.rows += other.rows;
            of_kind.checked += other.checked;
            of_kind.alone += other.alone;
        }
        self.seeds.extend(other.seeds);
        self.seeds.sort_unstable();
        self.seeds.truncate(SEEDS);
        self
    }

    /// Of the rows that seeds draw. `done` is told of each.
    pub fn over(
        seeds: std::ops::Range<u64>,
        draw: fn(u64) -> RandomRow,
        done: &(impl Fn() + Sync),
    ) -> Self {
        let tallies = seeds.into_par_iter().fold(Self::default, |tally, seed| {
            done();
            tally.add(Self::of(&draw(seed)))
        });
        tallies.reduce(Self::default, Self::add)
    }
}
