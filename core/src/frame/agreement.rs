//! Weighs the rows of a frame: more certain rows count more, rows further from the others count less.
//!
//! A row's weight is 1/u^2 times Tukey's biweight, (1 - (r/c)^2)^2, or zero where r is beyond c. u is the
//! row's own uncertainty, and r its residual from the mean in units of u. A wrong row lies away from the
//! others. It is left out if a majority agrees; without a majority nothing tells which rows are wrong. A
//! steady motion of the target is subtracted first.

use crate::base::numeric::{self, at_least, at_most, square};

use super::{
    Member, Members, birge_ratio, count_where, from_ordered, median, motion, ordered, ranked,
    scatter, weighted_mean,
};

/// Tukey's constant c, in standard deviations. For normal errors this mean has 95 % of the efficiency of the
/// best one (A. E. Beaton and J. W. Tukey, Technometrics 16, 147 (1974)).
const REACH: f32 = 4.685;
/// A standard deviation over the median of absolute deviations, for a normal distribution.
const DEVIATION_PER_MEDIAN: f32 = 1.4826;
/// A row agrees with the mean within this share of the reach, 2.3 standard deviations: 98 % of normal errors
/// do. A row that is just within reach counts for little, and does not confirm the others.
const AGREES: f32 = 0.5;
/// How often the weights are computed.
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
const ENOUGH_TO_SCATTER: usize = motion::ENOUGH;
/// From so many rows on, a frame without a majority is always a fault. With fewer rows the mean of all does
/// not claim too much: for two groups it is off by at most sqrt(n - 1) times the uncertainty that n rows with
/// such a scatter claim, four times for 17.
const ENOUGH_FOR_GROUPS: usize = 17;

/// Whether so many rows that agree prove the others wrong: two thirds of all, and at least three, because two
/// may agree by chance.
const fn is_majority(rows: usize, of: usize) -> bool {
    rows >= 3 && rows >= of.saturating_mul(2).div_ceil(3)
}

/// Weighs each row, removes rows that do not count, and subtracts the target's motion. Returns the motion in
/// pixels a row. `None` if the rest is not of one spot.
pub(super) fn weigh(members: &mut Members<'_>) -> Option<f32> {
    let is_whole = !leave_misfits_out(members);
    limit_certainty(members);
    let by_scatter = members.len() >= ENOUGH_TO_SCATTER;
    let mut motion = 0.0;
    // The frame's origin is the median of all rows.
    let start = if is_whole { 0.0 } else { middle(members) };
    reweigh(members, start);
    let passes = if by_scatter { MOTION_PASSES } else { 0 };
    for _ in 0..passes {
        let Some(slope) = motion::of(members) else {
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
pub(super) fn weigh_by_certainty(members: &mut [Member<'_>]) {
    limit_certainty(members);
    weigh_by_uncertainty(members);
}

/// Gives each row the weight 1/u^2.
pub(super) fn weigh_by_uncertainty(members: &mut [Member<'_>]) {
    for member in members {
        member.weight = certainty(member);
    }
}

/// 1/u^2.
pub(super) fn certainty(member: &Member<'_>) -> f32 {
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
