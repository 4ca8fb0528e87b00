//! Combines the centres of a frame's rows into one.
//!
//! The frame's centre is the mean of its rows' centres. In the weighted mean a row counts more the more
//! certain it is and the better it agrees with the others (`mean`); the plain mean is that of the paper.
//! The uncertainty is that of the rows, propagated. If the rows scatter more than their uncertainties
//! explain, it grows by the ratio (R. T. Birge, Phys. Rev. 40, 207 (1932)). If neighbours have similar
//! errors, it grows to that of fewer independent rows (`course`). If no majority of the rows agrees, or
//! the rows scatter by more than the spot's width, they do not show one spot: the frame has no centre.
//!
//! If the target moves, both means hold at one time: half-way between the frame's first row and its last. The
//! steady part of the motion is a line through the rows (`course`). If the mean of the rows' times is not the
//! middle of the frame, because rows are missing or count less, the line takes the centre to the middle.
//! Frames of fewer than eight rows show no motion: there the motion is scatter, and widens the uncertainty.

pub mod comb;
mod course;
mod mean;

use heapless::Vec;
use serde::{Deserialize, Serialize};

pub use crate::base::MAX_ROWS;
use crate::base::numeric::{self, square};
use crate::base::order_statistic::{self, from_ordered, ordered};
use crate::base::{Counts, Exposure, Fault, Pixels, named};
use crate::centre::RowCentre;
use crate::centre::spot_shape::{COMPONENTS, SpotShape};

use course::{Correlated, Course, Fluctuation};
use mean::{agreeing_mean, birge_ratio, plain_mean, scatter, spread};

/// How the rows' centres are combined into one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mean {
    /// The mean of all rows, as in the paper. If rows are missing and the target moves, the mean is taken to
    /// the middle of the frame, with the speed that the rows show. If all rows have a centre, it is the plain
    /// mean to the last bit.
    Plain,
    /// The mean weighted by the rows' uncertainties, and by how far each row is from the others.
    #[default]
    Weighted,
}

named! { Mean { Plain: "plain", Weighted: "weighted" } }

/// Below this effective number of rows, their scatter underestimates the error.
pub const FEWEST_INDEPENDENT: u16 = 8;

/// The rows of a frame, so far.
#[derive(Clone, Debug, Default)]
pub struct Frame {
    /// The centres, each with the number of its row.
    centres: Vec<(u16, RowCentre), { MAX_ROWS as usize }>,
    /// How often each kind of fault came, and the latest one.
    faults: [(u16, Option<Fault>); Fault::KINDS],
    /// The exposure of each row, where it is known.
    exposures: Vec<Option<Exposure>, { MAX_ROWS as usize }>,
    rows: u16,
}

/// The centre of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameCentre {
    /// The mean of the rows' centres. If the target moves, where the spot was in the middle of the frame:
    /// half-way between the first row and the last.
    pub centre: Pixels,
    /// The standard uncertainty of the centre that the rows' errors cause, and their scatter beyond those. If
    /// the target moves steadily, that motion is not scatter. [`Self::motion`] is not part of this
    /// uncertainty. Speckle that all rows share is not in it either.
    ///
    /// A motion counts from four standard deviations on. Slower motion goes unseen, and shifts the centre if
    /// the mean of the rows' times is not the middle of the frame: by up to 4 m / s uncertainties, where m
    /// is the mean of the times, taken from the middle of the frame, and s their standard deviation. That is
    /// 0.15 with every fourth row missing of 16, and 3.4 without the first third of 64 rows. At worst it is
    /// 6.5, without the first 31 of 64 rows.
    pub uncertainty: Pixels,
    /// The mean height of the spot: see [`RowCentre::amplitude`].
    pub amplitude: Counts,
    /// The mean exposure of the rows used. `None` if the exposure of one of them is not known.
    pub exposure: Option<Exposure>,
    /// The mean width of the spot: that of its shape, or the estimator's where the check could not tell it.
    pub width: Pixels,
    /// Rows in the mean: those with a centre, less those that disagree with the others.
    pub rows_used: u16,
    /// Rows in the frame.
    pub rows: u16,
    /// Rows used that have the flag [`RowCentre::misfit`].
    pub misfits: u16,
    /// The spot's antisymmetric light and its width, the mean of the rows used. Noise differs from row to
    /// row, so the mean shows less of it; a flaw stays.
    pub shape: SpotShape,
    /// See [`Reading::correlated`](crate::reading::Reading::correlated).
    pub correlated: Option<u16>,
    /// How far the rows' centres scatter beyond their own uncertainties: a standard deviation in pixels about
    /// their mean, or about their motion. Rows of a rough target that moves scatter so, because each row sees
    /// other speckle.
    ///
    /// The square is the variance of the rows (the sum of squares over the number of rows) less the mean
    /// square of their uncertainties. The plain mean counts all rows alike, the weighted mean with 1/u^2.
    /// Zero for fewer than three rows, and if chance explains the scatter. Chance alone gives a spread in
    /// 0.5 % of the frames of 64 rows, 1 % of 16, and 3 % of three.
    ///
    /// The spread shows how good the mean is: if speckle moves each row with the variance V, the mean has an
    /// error, by speckle and noise together, with the variance V - E\[spread^2\]. E is the mean over many
    /// frames; in one frame spread^2 may exceed V. The reason: rows vary about their mean by the variance of
    /// a row less the variance of the mean, whether or not their displacements are independent.
    ///
    /// V - E\[spread^2\] is too large in three cases. (1) Chance explains the scatter, so the spread is zero.
    /// (2) The rows show a motion, or displacements that drift look like one: a line through n independent
    /// rows hides V / n, a parabola 2 V / n. (3) The weighted mean leaves out rows that are far from it. It
    /// is too small if the rows do not show a motion, because the spread then contains the motion: a slow
    /// one, or any one in fewer than eight rows.
    pub spread: Pixels,
    /// The standard uncertainty of where the target was in the middle of the frame that comes from motion
    /// which a straight line does not describe. Independent of [`Self::uncertainty`]: combine both in
    /// quadrature.
    ///
    /// If the target accelerates by a pixels a row^2, the mean of its positions in n rows lies off its place
    /// in the middle by a (n^2 - 1)/24. A parabola through the rows gives that shift, with whichever rows are
    /// missing or count less. The centre stays a mean: the shift is not subtracted, and its whole size is
    /// this uncertainty.
    ///
    /// Zero if a straight line describes the motion, or if the curvature is less than four times its own
    /// standard deviation. Such a curvature shifts the centre by up to 4.5 times the uncertainty, and goes
    /// unseen. Zero for motion that neither a line nor a parabola describes: such motion is scatter. If the
    /// target swings half a period to two periods in the frame, the error is up to 1.3 times the uncertainty
    /// (root mean square over all phases). If the target swings more often, the centre is the mean of its
    /// places with the uncertainty of the mean, and not its place in the middle of the frame.
    pub motion: Pixels,
}

impl Frame {
    /// Adds a row's centre or fault. Rows beyond [`MAX_ROWS`] do not count.
    pub fn add(&mut self, row: Result<RowCentre, Fault>) {
        self.add_exposed(row, None);
    }

    /// As [`Frame::add`], with the row's exposure.
    pub fn add_exposed(&mut self, row: Result<RowCentre, Fault>, exposure: Option<Exposure>) {
        if u32::from(self.rows) >= MAX_ROWS {
            return;
        }
        // There is room for MAX_ROWS.
        let _ = self.exposures.push(exposure);
        match row {
            // There is room for MAX_ROWS.
            Ok(centre) => {
                let _ = self.centres.push((self.rows, centre));
            }
            Err(fault) => {
                // In bounds: `kind` is below `KINDS`.
                if let Some((count, latest)) = self.faults.get_mut(fault.kind()) {
                    *count = count.saturating_add(1);
                    *latest = Some(fault);
                }
            }
        }
        self.rows = self.rows.saturating_add(1);
    }

    /// Forgets the rows, for the next frame.
    pub fn clear(&mut self) {
        // The places of the centres need not be written.
        self.centres.clear();
        self.exposures.clear();
        self.faults = Default::default();
        self.rows = 0;
    }

    /// Rows added.
    pub const fn rows(&self) -> u16 {
        self.rows
    }

    /// Combines the rows.
    ///
    /// # Errors
    /// If half of the rows or more have no centre: the most common fault, as it came last. If two kinds are
    /// equally common, the one with the higher [`Fault::kind`]. [`Fault::Unsteady`] if no majority of the
    /// rows agrees, or the rows that agree scatter by more than the spot's width.
    pub fn centre(&self, how: Mean) -> Result<FrameCentre, Fault> {
        if self.centres.len() <= usize::from(self.rows) / 2 {
            let most = self.faults.iter().max_by_key(|(count, _)| *count);
            let latest = most.and_then(|&(_, fault)| fault);
            return Err(latest.unwrap_or(Fault::SensorSilent));
        }
        // Distances are taken from the median centre, so that fractions of a pixel keep all 24 bits of an
        // f32.
        let keys = (self.centres.iter()).map(|(_, row)| ordered(row.centre.to_bits()));
        let origin = median(keys).map_or(0, from_ordered);
        let mut members = Members::new();
        self.list(origin, &mut members);
        let found = match how {
            Mean::Plain => plain_mean(&mut members),
            Mean::Weighted => agreeing_mean(&mut members),
        };
        let Some((offset, course)) = found else {
            return Err(self.unsteady());
        };
        let width = Pixels::from_bits(mean(members.iter().map(|it| it.row.width.to_bits())));
        let is_steady = scatter(&members, course.speed) <= width.to_f32();
        if !is_steady {
            return Err(self.unsteady());
        }
        let fluctuation = Fluctuation::about(&mut members, &course);
        let Fluctuation {
            fitted, correlated, ..
        } = fluctuation;
        let excess = birge_ratio(&members, offset, fitted);
        let growth = correlated.map_or(1.0, |it| it.growth);
        let uncertainty = propagated(&members, &course) * excess * growth;
        let shows_spread = excess > 1.0 && members.len() as f32 - fitted >= 2.0;
        let spread = if shows_spread {
            spread(&members, how)
        } else {
            0.0
        };
        let shape = mean_shape(&members);
        Ok(FrameCentre {
            centre: Pixels::from_bits(origin.saturating_add(Pixels::from_f32(offset).to_bits())),
            // Never an uncertainty below one step.
            uncertainty: Pixels::from_f32(uncertainty).max(RESOLUTION),
            amplitude: Counts::from_bits(mean(members.iter().map(|it| it.row.amplitude.to_bits()))),
            exposure: self.mean_exposure(&members),
            width: if shape.width > Pixels::default() {
                shape.width
            } else {
                width
            },
            // At most the 64 rows there are.
            rows_used: numeric::to_u16(members.len()),
            rows: self.rows,
            misfits: numeric::to_u16(count_where(&members, |it| it.row.misfit)),
            shape,
            correlated: correlated.and_then(Correlated::rows_if_few),
            spread: Pixels::from_f32(spread),
            motion: Pixels::from_f32(fluctuation.shift),
        })
    }

    /// The mean exposure of some rows. `None` if that of one row is not known.
    fn mean_exposure(&self, members: &[Member<'_>]) -> Option<Exposure> {
        let middle = 0.5 * (f32::from(self.rows) - 1.0);
        let (mut sum, mut count) = (0u32, 0u32);
        for member in members {
            // The number of the row, a whole number from 0 to 63.
            let number = numeric::whole_usize(member.rows_from_middle + middle);
            let exposure = self.exposures.get(number).copied().flatten()?;
            sum = sum.saturating_add(exposure.us().into());
            count = count.saturating_add(1);
        }
        sum.checked_div(count).map(Exposure::nearest_to_us)
    }

    /// The fault of rows that do not agree: how far all of them scatter.
    fn unsteady(&self) -> Fault {
        let origin = mean(self.centres.iter().map(|(_, row)| row.centre.to_bits()));
        Fault::Unsteady {
            scatter: Pixels::from_f32(scatter(&self.members(origin), 0.0)),
        }
    }

    /// The rows with a centre, from an origin in the bits of [`Pixels`]. All have the same weight.
    fn members(&self, origin: i32) -> Members<'_> {
        let mut members = Members::new();
        self.list(origin, &mut members);
        members
    }

    /// As [`Self::members`], into an empty list: a list that is returned would be copied.
    fn list<'a>(&'a self, origin: i32, members: &mut Members<'a>) {
        let middle = 0.5 * (f32::from(self.rows) - 1.0);
        for (number, row) in &self.centres {
            let offset = Pixels::from_bits(row.centre.to_bits().saturating_sub(origin));
            // There is room for all centres.
            let _ = members.push(Member {
                row,
                rows_from_middle: f32::from(*number) - middle,
                offset: offset.to_f32(),
                uncertainty: row.uncertainty.max(RESOLUTION).to_f32(),
                weight: 1.0,
            });
        }
    }
}

/// The finest step of a centre, and so its least uncertainty: 2^-16 px.
const RESOLUTION: Pixels = Pixels::from_bits(1);

/// The rows that have a centre, in the order in which they came.
type Members<'a> = Vec<Member<'a>, { MAX_ROWS as usize }>;

/// A row as the mean uses it.
///
/// No sum over 64 members leaves the range of an f32 (2^127), and no division is by zero. Two centres differ
/// by less than 2^17 px. A line through some of them changes by at most 2^17 px a row, so a centre less that
/// line is below 2^24. An uncertainty is 2^-16 to 2^15 px. A residual, which is centre over uncertainty, is
/// below 2^40, from another line below 2^47, and 64 squares are below 2^100. A weight is at most 1/u^2 =
/// 2^32. 64 weights, each times an offset and the square of a row's number, are below 2^74; a weight times u
/// is at most 2^16. A row that agrees has a weight of more than half of its 1/u^2, which is 2^-30 or more, so
/// sums of weights are above zero.
///
/// A parabola through the members (`course`) has a shape below 2^14 rows^2. 64 weights, each times the square
/// of a shape, are below 2^66; each times a shape and an offset, below 2^76.
///
/// The mean of the rows' shapes (`mean_shape`): all lengths are at most 2^15 px, so the square of a weight
/// times a noise is at most 2^94, and 64 of these are at most 2^100. The other lengths are summed in their
/// steps, at most 2^31: 64 weights, each times the square of a rest, are at most 2^100. The rows that have a
/// shape may all be at the end of the reach. There the biweight is 2^-48 or more, the weight 2^-78 or more,
/// and one over the sum of weights at most 2^78. The square of such a weight may round to zero; a noise of
/// zero counts as one step ([`SpotShape::uncertainty`]).
#[derive(Clone, Copy)]
struct Member<'a> {
    row: &'a RowCentre,
    /// The row's number from the middle of the frame, -31.5 to 31.5.
    rows_from_middle: f32,
    /// The row's centre from the frame's origin, in pixels, less the motion since the middle of the frame.
    offset: f32,
    /// The uncertainty in pixels, never zero.
    uncertainty: f32,
    /// How much the row counts: 1 if all count alike, 0 if it does not count.
    weight: f32,
}

impl Member<'_> {
    /// The distance to `centre`, in uncertainties of the row.
    fn residual(&self, centre: f32) -> f32 {
        (self.offset - centre) / self.uncertainty
    }
}

/// The weighted mean of the rows' numbers, from the middle of the frame: the time at which a mean of the
/// rows holds. Not a number if no row counts.
fn mean_number(members: &[Member<'_>]) -> f32 {
    total(members, |it| it.weight * it.rows_from_middle) / total(members, |it| it.weight)
}

/// The uncertainty of the mean in pixels, if the uncertainty of each row is true and all rows are
/// independent. The uncertainty of the speed adds to it, as far as the mean of the rows' numbers is from the
/// middle of the frame: it comes from the rows' errors too, and grows with them.
fn propagated(members: &[Member<'_>], course: &Course) -> f32 {
    let (mut weights, mut variance) = (0.0, 0.0);
    for member in members {
        weights += member.weight;
        variance += square(member.weight * member.uncertainty);
    }
    let of_motion = match course.speed {
        0.0 => 0.0,
        _ => square(mean_number(members)) / course.moment,
    };
    dual_mac::square_root(variance / square(weights) + of_motion)
}

/// The mean of the rows' shapes, each row with its weight in the mean. Rows without a shape do not count.
fn mean_shape(members: &[Member<'_>]) -> SpotShape {
    let (mut weights, mut noise, mut width, mut rest) = (0.0, 0.0, 0.0, 0.0);
    let mut components = [0.0; COMPONENTS];
    for Member { row, weight, .. } in members {
        let shape = &row.shape;
        if shape.width <= Pixels::default() {
            continue;
        }
        weights += weight;
        noise += square(weight * shape.noise.to_f32());
        width += weight * shape.width.to_bits() as f32;
        rest += weight * square(shape.rest.to_bits() as f32);
        for (sum, component) in components.iter_mut().zip(shape.components) {
            *sum += weight * component.to_bits() as f32;
        }
    }
    if weights <= 0.0 {
        return SpotShape::default();
    }
    let per_weight = 1.0 / weights;
    let step = RESOLUTION.to_f32();
    SpotShape {
        components: components.map(|sum| Pixels::from_f32(sum * per_weight * step)),
        noise: Pixels::from_f32(dual_mac::square_root(noise) * per_weight),
        width: Pixels::from_f32(width * per_weight * step),
        rest: Pixels::from_f32(dual_mac::square_root(rest * per_weight) * step),
    }
}

fn total(members: &[Member<'_>], value: impl Fn(&Member<'_>) -> f32) -> f32 {
    members.iter().map(value).sum()
}

fn count_where(members: &[Member<'_>], is_so: impl Fn(&Member<'_>) -> bool) -> usize {
    numeric::count(members.iter().map(is_so))
}

// Twice the sum of a frame's values of 32 bits, and their number, fit 64.
const _: () = assert!(2 * (MAX_ROWS as i128) * (1 << 31) + (MAX_ROWS as i128) <= i64::MAX as i128);

/// The mean, rounded to the nearest. Zero for no values.
fn mean(values: impl ExactSizeIterator<Item = i32>) -> i32 {
    let count = i64::from(numeric::to_u32(values.len()));
    let sum = values.fold(0, |sum, value| numeric::add_i64(sum, i64::from(value)));
    let twice = numeric::add_i64(numeric::mul_i64(2, sum), count);
    // A mean lies between its values, so it fits.
    numeric::i64_to_i32(twice.checked_div_euclid(2 * count).unwrap_or_default())
}

/// The median of at most [`MAX_ROWS`] values. Of an even number of values, the lower one of the middle two.
/// `None` for no values.
fn median(values: impl ExactSizeIterator<Item = u32>) -> Option<u32> {
    let middle = values.len().checked_sub(1)? / 2;
    ranked(middle, values)
}

/// Returns the value at place `rank`, from zero, of at most [`MAX_ROWS`] values in ascending order. `None`
/// for no values.
fn ranked(rank: usize, values: impl Iterator<Item = u32>) -> Option<u32> {
    // Each value is computed once.
    let mut keys: Vec<u32, { MAX_ROWS as usize }> = Vec::new();
    for value in values {
        // There is room for MAX_ROWS.
        let _ = keys.push(value);
    }
    order_statistic::ranked(rank, &keys)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::found_at;

    pub(super) fn row(centre: f32, uncertainty: f32) -> Result<RowCentre, Fault> {
        Ok(RowCentre {
            uncertainty: Pixels::from_f32(uncertainty),
            ..found_at(centre, 9.0)
        })
    }

    fn frame(rows: impl IntoIterator<Item = Result<RowCentre, Fault>>) -> Frame {
        let mut frame = Frame::default();
        rows.into_iter().for_each(|row| frame.add(row));
        frame
    }

    fn mean_of(how: Mean, rows: impl IntoIterator<Item = Result<RowCentre, Fault>>) -> FrameCentre {
        frame(rows).centre(how).expect("a centre")
    }

    fn weighted(rows: impl IntoIterator<Item = Result<RowCentre, Fault>>) -> FrameCentre {
        mean_of(Mean::Weighted, rows)
    }

    /// Rows that are at two places in turn.
    fn two(
        count: usize,
        places: [f32; 2],
        uncertainty: f32,
    ) -> impl Iterator<Item = Result<RowCentre, Fault>> + Clone {
        (0..count).map(move |i| row(places[i % 2], uncertainty))
    }

    fn is_unsteady(found: &Result<FrameCentre, Fault>) -> bool {
        matches!(found, Err(Fault::Unsteady { .. }))
    }

    #[test]
    fn mean_and_propagated_uncertainty() {
        // Weights of 16 and 9 to 25; 1/u^2 adds up.
        for (how, centre, uncertainty) in [
            (Mean::Plain, 100.01, 0.025),
            (Mean::Weighted, 100.0 + 0.02 * 9.0 / 25.0, 0.024),
        ] {
            let found = mean_of(how, [row(100.0, 0.03), row(100.02, 0.04)]);
            assert!((found.centre.to_f64() - centre).abs() < 2e-5);
            assert!((found.uncertainty.to_f64() - uncertainty).abs() < 2e-5);
            assert_eq!((found.rows_used, found.rows), (2, 2));
        }
        let (one, expected) = (weighted([row(100.0, 0.03)]), row(100.0, 0.03).expect("one"));
        assert_eq!(one.centre, expected.centre);
        assert_eq!(one.uncertainty, expected.uncertainty);
    }

    #[test]
    fn misfits_are_counted_among_the_rows_used() {
        let good = row(100.0, 0.03);
        let misfit = good.map(|it| RowCentre { misfit: true, ..it });
        let silent = Err(Fault::SensorSilent);
        // Two thirds are good: the others are not needed.
        let few = [good, misfit, good, good];
        for (how, rows, expected) in [
            (
                Mean::Weighted,
                &[good, misfit, silent, good, misfit][..],
                (2, 4, 5),
            ),
            (Mean::Weighted, &[good], (0, 1, 1)),
            (Mean::Weighted, &[misfit], (1, 1, 1)),
            (Mean::Weighted, &few, (0, 3, 4)),
            (Mean::Plain, &few, (1, 4, 4)),
        ] {
            let found = mean_of(how, rows.iter().copied());
            assert_eq!((found.misfits, found.rows_used, found.rows), expected);
        }
    }

    /// The components of odd number have the other sign.
    fn shape(component: f32, noise: f32, width: f32, rest: f32) -> SpotShape {
        let [even, odd, noise, width, rest] =
            [component, -component, noise, width, rest].map(Pixels::from_f32);
        SpotShape {
            components: [even, odd, even, odd, even],
            noise,
            width,
            rest,
        }
    }

    /// Checks the mean shape of rows with these shapes and weights, to a step.
    fn assert_mean_shape(shapes: &[(SpotShape, f32)], expected: SpotShape) {
        let rows = shapes
            .iter()
            .map(|&(shape, _)| row(100.0, 0.03).map(|row| RowCentre { shape, ..row }));
        let frame = frame(rows);
        let mut members = frame.members(0);
        for (member, (_, weight)) in members.iter_mut().zip(shapes) {
            member.weight = *weight;
        }
        let found = mean_shape(&members);
        let values = |it: SpotShape| {
            it.components
                .into_iter()
                .chain([it.noise, it.width, it.rest])
        };
        for (a, b) in values(found).zip(values(expected)) {
            assert!(
                a.to_bits().abs_diff(b.to_bits()) <= 1,
                "{found:?}, {expected:?}"
            );
        }
    }

    /// The components and the width are weighted means, and the rest is a weighted mean of squares. The noise
    /// is that of a weighted sum of independent values, over the sum of the weights: only the noise falls
    /// with the number of rows.
    #[test]
    fn the_mean_shape_is_weighted_and_leaves_out_rows_without_a_shape() {
        let without = SpotShape {
            noise: Pixels::from_int(1),
            ..SpotShape::default()
        };
        let rows = [
            (shape(0.5, 0.03, 8.0, 0.25), 1.0),
            (without, 5.0),
            (shape(-0.3, 0.04, 10.0, 0.0), 3.0),
        ];
        let noise = libm::sqrtf(0.03 * 0.03 + 0.12 * 0.12) / 4.0;
        assert_mean_shape(&rows, shape(-0.1, noise, 9.5, 0.125));
        for rows in [&rows[1..2], &[]] {
            assert_mean_shape(rows, SpotShape::default());
        }
        for (rows, noise) in [(1, 0.04), (4, 0.02), (16, 0.01), (64, 0.005)] {
            for weight in [1.0, 1e-9, 4e9] {
                let same = [(shape(0.5, 0.04, 8.0, 0.25), weight); 64];
                assert_mean_shape(&same[..rows], shape(0.5, noise, 8.0, 0.25));
            }
        }
    }

    /// Chi square of n degrees has the mean n and the standard deviation sqrt(2 n).
    #[test]
    fn chance_ends_three_standard_deviations_beyond_the_mean() {
        for (chi_square, degrees, is_more) in [
            (79.9, 50.0, false),
            (80.1, 50.0, true),
            (13.9, 5.0, false),
            (14.6, 5.0, true),
            (5.2, 1.0, false),
            (5.3, 1.0, true),
            (1e9, 0.0, false),
        ] {
            let found = mean::is_more_than_chance(chi_square, degrees);
            assert_eq!(found, is_more, "{degrees}");
        }
    }

    /// Four rows, +-0.5 with a claim of 0.1: chi square 4 * 25 = 100, three degrees, ratio sqrt(100/3). No
    /// three of them agree. The spread is a variance of 0.25 about the mean, 0.01 of it claimed.
    #[test]
    fn scatter_beyond_chance_widens_the_uncertainty_and_is_a_spread() {
        for how in Mean::ALL {
            let find = |count, off: f32| mean_of(how, two(count, [100.0 - off, 100.0 + off], 0.1));
            let found = find(4, 0.5);
            let uncertainty = found.uncertainty.to_f64() - 0.1 / 2.0 * (100.0f64 / 3.0).sqrt();
            assert!(uncertainty.abs() < 1e-4, "{found:?}");
            assert_eq!(found.centre, Pixels::from_int(100));
            assert!((found.spread.to_f64() - 0.24f64.sqrt()).abs() < 1e-4);
            // Three rows: 2/9, and two rows do not tell.
            let spread = find(3, 0.5).spread.to_f64();
            assert!((spread - (2.0 / 9.0 - 0.01f64).sqrt()).abs() < 1e-4);
            assert_eq!(find(2, 0.5).spread, Pixels::default());
            // 0.13 with a claim of 0.1: chi square 6.8 of three degrees is chance.
            assert_eq!(find(4, 0.13).spread, Pixels::default());
        }
        // Rows at 0 and 1 with the weights 4 and 1 have their mean at 1/5 and a variance of 4/25. The mean of
        // u^2 with these weights is (4 * 0.01 + 1 * 0.04) / 5. With equal weights: 1/4, and 0.025.
        for (how, variance, claimed) in
            [(Mean::Weighted, 0.16, 0.016f64), (Mean::Plain, 0.25, 0.025)]
        {
            let unlike = (0..4).map(|i| row(i as f32 % 2.0, if i % 2 == 0 { 0.1 } else { 0.2 }));
            let found = mean_of(how, unlike).spread.to_f64();
            assert!(
                (found - (variance - claimed).sqrt()).abs() < 1e-4,
                "{found}"
            );
        }
    }

    #[test]
    fn a_moving_target_is_where_it_is_in_the_middle_of_the_frame() {
        let moving = |speed: f32, acceleration: f32, first: u8| {
            (0..16u8).map(move |i| {
                let x = f32::from(i) - 7.5;
                if i < first {
                    Err(Fault::SensorSilent)
                } else {
                    row(1200.0 + speed * x + 0.5 * acceleration * x * x, 0.02)
                }
            })
        };
        let close = |found: Pixels, to: f64| (found.to_f64() - to).abs() < 2e-4;
        for how in Mean::ALL {
            // Eleven rows, whose mean number is 2.5 from the middle. Their moment is 11 (11^2 - 1)/12 = 110.
            for (first, variance) in [(0, 1.0 / 16.0), (5, 1.0 / 11.0 + 2.5f64.powi(2) / 110.0)] {
                let found = mean_of(how, moving(0.5, 0.0, first));
                assert!(close(found.centre, 1200.0), "{found:?}");
                assert!(
                    close(found.uncertainty, 0.02 * variance.sqrt()),
                    "{found:?}"
                );
                assert_eq!((found.motion, found.spread), Default::default());
            }
            // 0.02 (16^2 - 1)/24 px. The weighted mean counts the ends less.
            let bent = mean_of(how, moving(0.1, 0.02, 0));
            let off = (bent.centre.to_f64() - 1200.0).abs();
            assert!(close(bent.motion, off), "{bent:?}");
            assert!(
                how == Mean::Weighted || close(bent.motion, 0.2125),
                "{bent:?}"
            );
            assert_eq!(bent.spread, Pixels::default());
            assert!(
                (0.005..0.0055).contains(&bent.uncertainty.to_f64()),
                "{bent:?}"
            );
        }
        // Seven rows show no motion: it is scatter.
        let few = weighted(moving(0.1, 0.0, 0).take(7));
        assert!(few.spread.to_f64() > 0.19, "{few:?}");
    }

    #[test]
    fn a_row_that_is_wrong_is_left_out_where_the_others_agree() {
        // However certain the wrong row is of its centre.
        for uncertainty in [0.2, 0.02, 1e-5] {
            let rows = (0..5).map(|i| row(if i == 1 { 103.0 } else { 100.0 }, 0.02));
            let found = weighted(rows.chain([row(103.0, uncertainty)]));
            assert_eq!(found.centre, Pixels::from_int(100), "{uncertainty}");
            assert_eq!(found.rows_used, 4);
        }
        // Among three rows nothing tells which is wrong: the result is the mean, with an uncertainty that
        // covers them all.
        let found = weighted(two(3, [100.0, 103.0], 0.02));
        assert_eq!(found.rows_used, 3);
        assert!((found.uncertainty.to_f64() - 1.0).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn rows_without_a_majority_have_no_centre() {
        for count in [8, 15, 16, 40, 64] {
            let found = frame(two(count, [100.0, 103.0], 0.02)).centre(Mean::Weighted);
            assert!(is_unsteady(&found), "{count}");
        }
        // Two groups, and some rows between them. The scatter of the rows would allow all of them.
        let groups = (0..64).map(|i| match i % 16 {
            0 => row(101.5, 0.02),
            odd if odd % 2 == 1 => row(100.0, 0.02),
            _ => row(103.0, 0.02),
        });
        let found = frame(groups).centre(Mean::Weighted);
        assert!(is_unsteady(&found), "{found:?}");
    }

    #[test]
    fn any_rows_have_a_centre_with_an_uncertainty_or_a_fault() {
        let extremes = [i32::MIN, -1, 0, 1, 1 << 16, i32::MAX];
        let frames = [(1, 1), (2, 2), (3, 2), (16, 8), (64, 7), (64, 2)];
        // Miri takes its time.
        let (extremes, frames) = match cfg!(miri) {
            true => (&extremes[..2], &frames[..4]),
            false => (&extremes[..], &frames[..]),
        };
        let pairs = || {
            extremes
                .iter()
                .flat_map(|&a| extremes.iter().map(move |&b| (a, b)))
        };
        let any = |(centre, uncertainty): (i32, i32)| {
            row(0.0, 0.0).map(|row| RowCentre {
                centre: Pixels::from_bits(centre),
                uncertainty: Pixels::from_bits(uncertainty),
                amplitude: Counts::from_bits(centre),
                width: Pixels::MAX,
                ..row
            })
        };
        let mut found = 0;
        for (one, another) in pairs().flat_map(|one| pairs().map(move |another| (one, another))) {
            let (a, c) = (one.0, another.0);
            for &(count, other) in frames {
                let rows = (0..count).map(|i| any(if i % other == 0 { one } else { another }));
                for how in Mean::ALL {
                    let Ok(centre) = frame(rows.clone()).centre(how) else {
                        continue;
                    };
                    found += 1;
                    let zero = Pixels::default();
                    assert!(centre.uncertainty > zero, "{centre:?}");
                    assert!(centre.spread >= zero && centre.motion >= zero, "{centre:?}");
                    // To within the 24 bits of an f32.
                    let bits = i64::from(centre.centre.to_bits());
                    let (low, high) = (i64::from(a.min(c)) - 256, i64::from(a.max(c)) + 256);
                    assert!(
                        (low..=high).contains(&bits),
                        "{centre:?} of {one:?}, {another:?}"
                    );
                }
            }
        }
        assert!(cfg!(miri) || found > 10_000, "{found}");
    }

    #[test]
    fn the_commonest_fault_wins_where_half_the_rows_fail() {
        let good = row(1.0, 0.1);
        let saturated = |pixels| Err(Fault::Saturated { pixels });
        let centre = Pixels::from_int(3);
        let edge = Err(Fault::SpotAtEdge { centre });
        for (rows, expected) in [
            (
                &[good, saturated(1), edge, saturated(2)][..],
                Some(Fault::Saturated { pixels: 2 }),
            ),
            (&[good, saturated(1)], Some(Fault::Saturated { pixels: 1 })),
            (&[good, good, saturated(1)], None),
            (&[], Some(Fault::SensorSilent)),
        ] {
            let found = frame(rows.iter().copied()).centre(Mean::Weighted);
            assert_eq!(found.err(), expected);
        }
    }

    #[test]
    fn rows_of_two_spots_have_no_centre() {
        let two = frame((0..16).map(|i| row(if i < 9 { 1200.0 } else { 2400.0 }, 0.02)));
        let Err(Fault::Unsteady { scatter }) = two.centre(Mean::Weighted) else {
            panic!("{:?}", two.centre(Mean::Weighted))
        };
        // Nine and seven of sixteen, 1200 px apart: 1200 sqrt(9 * 7) / 16.
        let expected = 1200.0 * 63f64.sqrt() / 16.0;
        assert!((scatter.to_f64() - expected).abs() < 0.01, "{scatter}");
        // Width 9: the rows of a target that moves by 3 px a row scatter by 13.8 px, by 1 px a row by 4.6 px.
        let moving = |speed: f32| {
            frame((0..16).map(|i| row(1200.0 + speed * i as f32, 0.02))).centre(Mean::Weighted)
        };
        assert!(is_unsteady(&moving(3.0)) && moving(1.0).is_ok());
    }

    #[test]
    fn a_full_frame_takes_no_more() {
        let mut full = frame((0..100).map(|_| row(5.0, 0.1)));
        (0..100).for_each(|_| full.add(Err(Fault::SensorSilent)));
        assert_eq!(full.rows(), 64);
        assert_eq!(full.centre(Mean::Weighted).expect("a centre").rows_used, 64);
    }
}
