//! The mean of a frame's rows, and how far they scatter about it.
//!
//! In the weighted mean, more certain rows count more, and rows further from the others count less.
//!
//! A row's weight is 1/u^2 times Tukey's biweight, (1 - (r/c)^2)^2, or zero where r is beyond c. u is the
//! row's own uncertainty, and r its residual from the mean in units of u. A wrong row lies away from the
//! others. It is left out if a majority agrees; without a majority nothing tells which rows are wrong. A
//! steady motion of the target is subtracted first.

use crate::base::numeric::{self, at_least, at_most, square};
use crate::base::order_statistic::{from_ordered, ordered};

use super::course::{self, Course};
use super::{Mean, Member, Members, count_where, mean_number, median, ranked, total};

/// Tukey's constant c, in standard deviations. For normal errors this mean has 95 % of the efficiency of the
/// best one (A. E. Beaton and J. W. Tukey, Technometrics 16, 147 (1974)).
const REACH: f32 = 4.685;
/// A standard deviation over the median of absolute deviations, for a normal distribution.
const DEVIATION_PER_MEDIAN: f32 = 1.4826;
/// A row agrees with the mean within this share of the reach, 2.3 standard deviations: 98 % of normal errors
/// do. A row that is just within reach counts for little, and does not confirm the others.
const AGREES: f32 = 0.5;
const REWEIGHTS: usize = 5;
/// How often a motion is estimated and subtracted: a motion makes the rows scatter, so wrong rows may mislead
/// the first estimate.
const MOTION_PASSES: usize = 4;
/// A row counts at most as if it were so many times as certain as the median row. So a row that claims too
/// small an uncertainty weighs at most as much as 64 others.
const MOST_CERTAIN: f32 = 8.0;
/// From so many rows on, their own scatter tells how far from the mean a good row may lie. The median
/// deviation of n normal values is known to 1.17 / sqrt(n), 41 % for 8 rows. With fewer rows only their
/// uncertainties tell it.
const ENOUGH_TO_SCATTER: usize = course::ENOUGH;
/// From so many rows on, a frame without a majority is always a fault. With fewer rows the mean of all does
/// not claim too much: for two groups it is off by at most sqrt(n - 1) times the uncertainty that n rows with
/// such a scatter claim, four times for 17.
const ENOUGH_FOR_GROUPS: usize = 17;

/// The plain mean in the middle of the frame, in pixels from the frame's origin, and the motion of the
/// target. Subtracts the steady part of the motion from the members.
///
/// The motion comes from a copy of the rows with weights of 1/u^2. The speed and its error reach the mean
/// only as far as the mean of the rows' numbers is from zero.
pub(super) fn plain_mean(members: &mut Members<'_>) -> Option<(f32, Course)> {
    let mean = weighted_mean(members)?;
    let mut certain = Members::new();
    copy(members, &mut certain, |it| *it);
    weigh_by_certainty(&mut certain);
    let speed = match course::speed(&certain) {
        Some(speed) if members.len() >= course::ENOUGH => speed,
        _ => 0.0,
    };
    for member in members.iter_mut().chain(certain.iter_mut()) {
        member.offset -= speed * member.rows_from_middle;
    }
    // The new offsets have rounding errors; this mean of a full frame has none, because its mean number is
    // zero.
    let offset = mean - speed * mean_number(members);
    Some((offset, Course::of(&certain, &certain, speed)))
}

/// The weighted mean of the rows that agree, and the motion, as [`plain_mean`].
///
/// An acceleration comes from a copy of these rows with weights of 1/u^2. The ends of a parabola look like
/// rows that disagree: with the weights of the mean its curvature would be up to 8 % too small (measured on
/// 64 rows, with a shift of ten uncertainties).
pub(super) fn agreeing_mean(members: &mut Members<'_>) -> Option<(f32, Course)> {
    let speed = weigh(members)?;
    let mut certain = Members::new();
    copy(members, &mut certain, |it| Member {
        weight: certainty(it),
        ..*it
    });
    let mean = weighted_mean(members)?;
    Some((mean, Course::of(members, &certain, speed)))
}

/// The weighted mean in pixels from the frame's origin. `None` if no row counts.
fn weighted_mean(members: &[Member<'_>]) -> Option<f32> {
    let (mut weights, mut sum) = (0.0, 0.0);
    for member in members {
        weights += member.weight;
        sum += member.weight * member.offset;
    }
    (weights > 0.0).then(|| sum / weights)
}

/// Whether so many rows that agree prove the others wrong: two thirds of all, and at least three, because two
/// may agree by chance.
const fn is_majority(rows: usize, of: usize) -> bool {
    rows >= 3 && rows >= of.saturating_mul(2).div_ceil(3)
}

/// Weighs each row, removes rows that do not count, and subtracts the target's motion. Returns the motion in
/// pixels a row. `None` if the rest is not of one spot.
fn weigh(members: &mut Members<'_>) -> Option<f32> {
    let is_whole = !leave_misfits_out(members);
    limit_certainty(members);
    let by_scatter = members.len() >= ENOUGH_TO_SCATTER;
    let mut motion = 0.0;
    // The frame's origin is the median of all rows.
    let start = if is_whole { 0.0 } else { middle(members) };
    reweigh(members, start);
    let passes = if by_scatter { MOTION_PASSES } else { 0 };
    for _ in 0..passes {
        let Some(slope) = course::speed(members) else {
            break;
        };
        motion += slope;
        for member in members.iter_mut() {
            member.offset -= slope * member.rows_from_middle;
        }
        let start = middle(members);
        reweigh(members, start);
    }
    let agreeing = count_where(members, |it| {
        it.weight * square(it.uncertainty) > biweight(AGREES)
    });
    if is_majority(agreeing, members.len()) {
        if members.iter().any(|it| it.weight <= 0.0) {
            keep(members, |it| it.weight > 0.0);
        }
        let is_fault = members.len() >= ENOUGH_FOR_GROUPS && are_two_groups(members);
        return (!is_fault).then_some(motion);
    }
    // Without a majority all rows count, and their scatter widens the mean's uncertainty.
    weigh_by_uncertainty(members);
    let is_fault = members.len() >= ENOUGH_FOR_GROUPS || by_scatter && are_two_groups(members);
    (!is_fault).then_some(motion)
}

/// Gives each row the weight 1/u^2, with a limit to its certainty. No row is left out.
fn weigh_by_certainty(members: &mut [Member<'_>]) {
    limit_certainty(members);
    weigh_by_uncertainty(members);
}

fn weigh_by_uncertainty(members: &mut [Member<'_>]) {
    for member in members {
        member.weight = certainty(member);
    }
}

/// 1/u^2.
fn certainty(member: &Member<'_>) -> f32 {
    1.0 / square(member.uncertainty)
}

/// Leaves out the rows whose pixels do not fit their spot, because such a row is off by more than its
/// uncertainty. Only a majority of better rows can do so. Otherwise the frame keeps such rows, and the
/// reading counts them. Returns whether rows were left out.
fn leave_misfits_out(members: &mut Members<'_>) -> bool {
    let fitting = count_where(members, |it| !it.row.misfit);
    let are_left_out = fitting < members.len() && is_majority(fitting, members.len());
    if are_left_out {
        keep(members, |it| !it.row.misfit);
    }
    are_left_out
}

/// As `Vec::retain`, but without its counters: the compiler cannot prove that those do not overflow.
fn keep(members: &mut Members<'_>, is_kept: impl Fn(&Member<'_>) -> bool) {
    let mut kept = 0;
    for number in 0..members.len() {
        let Some(&member) = members.get(number).filter(|it| is_kept(it)) else {
            continue;
        };
        // No more are kept than there are.
        if let Some(place) = members.get_mut(kept) {
            *place = member;
        }
        kept = numeric::add_usize(kept, 1);
    }
    members.truncate(kept);
}

/// Raises the uncertainty of rows that claim to be more than [`MOST_CERTAIN`] times as certain as the median
/// row.
fn limit_certainty(members: &mut [Member<'_>]) {
    let (mut least, mut most) = (f32::INFINITY, 0.0);
    for member in members.iter() {
        least = at_most(member.uncertainty, least);
        most = at_least(member.uncertainty, most);
    }
    // The median is at most `most`: no row is so certain.
    if most <= MOST_CERTAIN * least {
        return;
    }
    // Uncertainties are above zero, and in the order of their bits.
    let Some(middle) = median(members.iter().map(|it| it.uncertainty.to_bits())) else {
        return;
    };
    let least = f32::from_bits(middle) / MOST_CERTAIN;
    for member in members {
        if member.uncertainty < least {
            member.uncertainty = least;
        }
    }
}

/// The rows' scatter about a centre over the scatter that their uncertainties explain: at least 1, and 1 for
/// few rows.
fn scale(members: &[Member<'_>], centre: f32) -> f32 {
    if members.len() < ENOUGH_TO_SCATTER {
        return 1.0;
    }
    let scale = |it: &Member<'_>| DEVIATION_PER_MEDIAN * it.residual(centre).abs();
    let explained = count_where(members, |it| scale(it) <= 1.0);
    let middle = members.len().saturating_sub(1) / 2;
    // If the median row is not among those that their uncertainties explain, its scale is above 1.
    middle.checked_sub(explained).map_or(1.0, |rank| {
        let others = members.iter().map(scale).filter(|&it| it > 1.0);
        ranked(rank, others.map(f32::to_bits)).map_or(1.0, f32::from_bits)
    })
}

/// The median of the offsets.
fn middle(members: &[Member<'_>]) -> f32 {
    // Orders the offsets by their bits, with those of negative numbers turned over.
    let key = |it: &Member<'_>| ordered(in_order(it.offset.to_bits().cast_signed()));
    median(members.iter().map(key)).map_or(0.0, |key| {
        f32::from_bits(in_order(from_ordered(key)).cast_unsigned())
    })
}

/// Gives each row the weight of its residual from the weighted mean, starting from the rows' median.
fn reweigh(members: &mut [Member<'_>], median: f32) {
    let mut centre = median;
    let reach = REACH * scale(members, centre);
    for _ in 0..REWEIGHTS {
        let (mut weights, mut sum) = (0.0, 0.0);
        for member in members.iter_mut() {
            member.weight = biweight(member.residual(centre) / reach) / square(member.uncertainty);
            weights += member.weight;
            sum += member.weight * member.offset;
        }
        if weights > 0.0 {
            centre = sum / weights;
        } else {
            // No row is within reach: none counts.
            return;
        }
    }
}

/// Maps the bits of an f32 to an integer in the order of its value, and back: bits of negative values count
/// downwards.
const fn in_order(bits: i32) -> i32 {
    if bits < 0 { bits ^ i32::MAX } else { bits }
}

fn biweight(residual: f32) -> f32 {
    let rest = 1.0 - square(residual);
    if rest > 0.0 { square(rest) } else { 0.0 }
}

/// Whether the rows scatter more than chance explains, and keep away from their mean. Within half a standard
/// deviation of the mean are 38 % of normal errors, 23 % of the rows of a target that swings, and no row of
/// two groups. Fewer than one row of 16 is there in 0.3 % of frames of 17 rows with normal errors, and in
/// fewer frames of more rows.
fn are_two_groups(members: &[Member<'_>]) -> bool {
    let rows = members.len();
    let Some(centre) = weighted_mean(members) else {
        return false;
    };
    if birge_ratio(members, centre, 1.0) <= 1.0 {
        return false;
    }
    let mean = members.iter().map(|it| it.offset).sum::<f32>() / rows as f32;
    let near = 0.5 * scatter(members, 0.0);
    count_where(members, |it| (it.offset - mean).abs() < near) < rows.div_ceil(16)
}

/// Copies the members into an empty list, each changed. Not `Vec::clone`: see `keep`.
pub(super) fn copy<'a>(
    members: &[Member<'a>],
    copies: &mut Members<'a>,
    change: impl Fn(&Member<'a>) -> Member<'a>,
) {
    for member in members {
        // There is room for as many as there were.
        let _ = copies.push(change(member));
    }
}

/// See [`FrameCentre::spread`]. The members are without their motion.
pub(super) fn spread(members: &[Member<'_>], how: Mean) -> f32 {
    // Not the members' weights: those of the weighted mean are smaller for rows further from it, so they show
    // 83 % of a normal variance.
    let share = |it: &Member<'_>| match how {
        Mean::Plain => 1.0,
        Mean::Weighted => 1.0 / square(it.uncertainty),
    };
    let shares = total(members, share);
    let centre = total(members, |it| share(it) * it.offset) / shares;
    let excess = total(members, |it| {
        share(it) * (square(it.offset - centre) - square(it.uncertainty))
    }) / shares;
    dual_mac::square_root(at_least(excess, 0.0))
}

/// The rows' scatter over the scatter that their uncertainties explain, or 1 if chance explains it. `fitted`
/// is the number of parameters that come from the rows themselves, as in [`Fluctuation`].
pub(super) fn birge_ratio(members: &[Member<'_>], centre: f32, fitted: f32) -> f32 {
    let chi_square: f32 = members.iter().map(|it| square(it.residual(centre))).sum();
    let degrees = members.len() as f32 - fitted;
    if is_more_than_chance(chi_square, degrees) {
        dual_mac::square_root(chi_square / degrees)
    } else {
        1.0
    }
}

/// Whether chi square exceeds its mean, the degrees of freedom, by more than three standard deviations. Its
/// variance is twice the degrees of freedom.
pub(super) fn is_more_than_chance(chi_square: f32, degrees: f32) -> bool {
    degrees >= 1.0 && chi_square > degrees + 3.0 * dual_mac::square_root(2.0 * degrees)
}

/// Standard deviation of the rows' centres about their plain mean, in pixels, with a motion in pixels a row.
pub(super) fn scatter(members: &[Member<'_>], motion: f32) -> f32 {
    let offset = |member: &Member<'_>| member.offset + motion * member.rows_from_middle;
    let n = members.len().max(1) as f32;
    let mean = members.iter().map(offset).sum::<f32>() / n;
    let squares: f32 = members.iter().map(|it| square(offset(it) - mean)).sum();
    dual_mac::square_root(squares / n)
}
