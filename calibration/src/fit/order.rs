//! What makes points no calibration, whatever curve is sought: too few, repeated, out of order, or centres
//! that go back while distances go on.
//!
//! **Order of the lines.** Distances are what a person or a stage sets: they rise or fall from line to line.
//! A line out of order is a slip in the file, except where it turns out to be an outlier, a distance that was
//! mistyped: then it is rejected like any other.
//!
//! **Centres along the distances** rise or fall as well. Here noise and outliers do not count, and a fold
//! does: that the centre turns and comes back, so that two distances have one centre. A fold is found where
//! medians of groups of points go back, or five points in a row by more than their scatter. (A lesser one
//! than that is outliers, which are named.)
//!
//! With fewer than ten points nothing can be rejected: any step back counts.

use anyhow::{bail, ensure};
use statistics::median;

use crate::points::Point;

/// From so many points on outliers are looked for: of fewer, the rest would say too little.
pub const FEWEST_TO_REJECT: usize = 10;

/// How many points of so many may be rejected: a fifth.
pub const fn most_rejected(points: usize) -> usize {
    if points < FEWEST_TO_REJECT {
        0
    } else {
        points / 5
    }
}

/// Steps back in a row that make a fold.
const FOLD: usize = 4;
/// Steps back by less, in standard deviations of their difference, are noise.
const NOISE: f64 = 6.0;

/// Looks at the points before any fit. Gives the lines that are out of order, which only outliers may be.
pub fn before(points: &[Point]) -> anyhow::Result<Vec<OutOfOrder>> {
    ensure!(
        points.len() >= 3,
        "there {} in the file, and eq. (1) has three parameters: take three at least, better 20 or more",
        match points.len() {
            0 => "are no points".into(),
            1 => format!("is one point (line {})", points[0].line),
            count => format!(
                "are {count} points (lines {} and {})",
                points[0].line, points[1].line
            ),
        }
    );
    repeated(points)?;
    let out_of_order = out_of_order(points);
    if let Some(first) = out_of_order.first()
        && out_of_order.len() > most_rejected(points.len())
    {
        bail!("{first}");
    }
    if points.len() < FEWEST_TO_REJECT {
        steps_back(points)?;
    } else {
        groups_go_back(points)?;
    }
    Ok(out_of_order)
}

/// Looks at them when it is known which are kept, and how far centres scatter, in pixels.
pub fn after(
    points: &[Point],
    out_of_order: &[OutOfOrder],
    kept: &[bool],
    scatter: &[f64],
) -> anyhow::Result<()> {
    if let Some(line) = out_of_order.iter().find(|line| kept[line.index]) {
        bail!("{line}");
    }
    folds(points, scatter)
}

/// A line whose distance does not go on from those before it.
#[derive(Clone, Debug, PartialEq)]
pub struct OutOfOrder {
    index: usize,
    point: Point,
    /// The line with which it does not go together.
    other: Point,
    rise: bool,
}

impl std::fmt::Display for OutOfOrder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut lines = [&self.other, &self.point].map(|point| (point.line, point.d_mm));
        lines.sort_by_key(|(line, _)| *line);
        let [(before, before_mm), (after, after_mm)] = lines;
        let go = if self.rise { "rise" } else { "fall" };
        write!(
            f,
            "line {after}: its distance, {after_mm} mm, comes after the {before_mm} mm of line {before}, \
             where the others {go} from line to line: sort the lines by distance, or correct it"
        )
    }
}

/// A centre or a distance twice.
fn repeated(points: &[Point]) -> anyhow::Result<()> {
    let twice = |value: fn(&Point) -> f64| {
        let mut sorted: Vec<&Point> = points.iter().collect();
        sorted.sort_by(|a, b| value(a).total_cmp(&value(b)).then(a.line.cmp(&b.line)));
        let pairs = sorted.windows(2).map(|pair| (*pair[0], *pair[1]));
        let same = pairs.filter(|(first, later)| value(first) == value(later));
        same.min_by_key(|(_, later)| later.line)
    };
    if let Some((first, later)) = twice(|point| point.d_mm) {
        let (line, d_mm, again) = (first.line, first.d_mm, later.line);
        ensure!(
            first.x_px != later.x_px,
            "line {again} repeats line {line}: remove one of them"
        );
        bail!(
            "line {again} has the distance of line {line}, {d_mm} mm, with another centre: keep one of them, \
             or their mean"
        );
    }
    if let Some((Point { line, x_px, .. }, later)) = twice(|point| point.x_px) {
        bail!(
            "line {} has the centre of line {line}, {x_px} px, at another distance: no calibration can tell \
             the two apart; take one of them again, or remove it",
            later.line
        );
    }
    Ok(())
}

/// The lines outside of the longest run of distances that rise, or fall, whichever is longer.
fn out_of_order(points: &[Point]) -> Vec<OutOfOrder> {
    let (run, sign) = longest_run(points.iter().map(|point| point.d_mm));
    let rise = sign > 0.0;
    let left_out = (0..points.len()).filter(|index| run.binary_search(index).is_err());
    let line = |index| {
        let after = run.partition_point(|&member| member < index);
        // It lies above the next of the run, or below the last.
        let neighbours = [after.checked_sub(1), Some(after)].into_iter().flatten();
        let mut members = neighbours.filter_map(|place| run.get(place).copied());
        let is_less = |a: usize, b: usize| sign * points[a].d_mm < sign * points[b].d_mm;
        let other = members.find(|&member| is_less(member, index) != (member < index));
        OutOfOrder {
            index,
            point: points[index],
            other: points[other.unwrap_or(index)],
            rise,
        }
    };
    left_out.map(line).collect()
}

/// The places of the longest run of numbers that rise, and 1, or of those that fall, and -1.
fn longest_run(numbers: impl Iterator<Item = f64> + Clone) -> (Vec<usize>, f64) {
    let [rising, falling] = [1.0, -1.0].map(|sign| {
        let numbers: Vec<f64> = numbers.clone().map(|number| sign * number).collect();
        longest_rise(&numbers)
    });
    match rising.len() >= falling.len() {
        true => (rising, 1.0),
        false => (falling, -1.0),
    }
}

/// The places of the longest run of numbers that rise; of several the one that takes the earliest.
fn longest_rise(numbers: &[f64]) -> Vec<usize> {
    // From the end: the largest number that a run of each length may begin with, and each place's run.
    let mut heads: Vec<f64> = Vec::new();
    let mut lengths = vec![0; numbers.len()];
    for (place, &number) in numbers.iter().enumerate().rev() {
        let length = heads.partition_point(|&head| head > number);
        match heads.get_mut(length) {
            Some(head) => *head = number,
            None => heads.push(number),
        }
        lengths[place] = length + 1;
    }
    let mut run: Vec<usize> = Vec::new();
    let mut left = heads.len();
    for (place, &number) in numbers.iter().enumerate() {
        if lengths[place] == left && run.last().is_none_or(|&last| numbers[last] < number) {
            run.push(place);
            left -= 1;
        }
    }
    run
}

fn by_distance(points: &[Point]) -> Vec<&Point> {
    let mut sorted: Vec<&Point> = points.iter().collect();
    sorted.sort_by(|a, b| a.d_mm.total_cmp(&b.d_mm));
    sorted
}

/// The line of a point, its centre and its distance.
fn figures(point: &&Point) -> (u64, f64, f64) {
    (point.line, point.x_px, point.d_mm)
}

/// Few points: each goes on from the one before.
fn steps_back(points: &[Point]) -> anyhow::Result<()> {
    let sorted = by_distance(points);
    let (run, sign) = longest_run(sorted.iter().map(|point| point.x_px));
    if run.len() == sorted.len() {
        return Ok(());
    }
    let goes_back = |pair: &&[&Point]| sign * pair[1].x_px < sign * pair[0].x_px;
    if let Some([near, far]) = sorted.windows(2).find(goes_back) {
        let [(near, from_px, from), (far, to_px, to)] = [near, far].map(figures);
        bail!(
            "line {far}: its centre, {to_px} px, goes back from the {from_px} px of line {near} while the \
             distance goes on from {from} to {to} mm: take it again, or leave it out (a wrong point can be \
             told from good ones where there are {FEWEST_TO_REJECT} or more)"
        );
    }
    Ok(())
}

/// Many points: the medians of three to six groups of them go on.
fn groups_go_back(points: &[Point]) -> anyhow::Result<()> {
    let sorted = by_distance(points);
    let count = (sorted.len() / 10).clamp(3, 6);
    let group = |i| &sorted[i * sorted.len() / count..(i + 1) * sorted.len() / count];
    let groups: Vec<&[&Point]> = (0..count).map(group).collect();
    let middle = |group: &&[&Point]| median(group.iter().map(|point| point.x_px));
    let medians: Vec<f64> = groups.iter().map(middle).collect();
    let ends = medians[count - 1] - medians[0];
    let steps: Vec<f64> = medians.windows(2).map(|pair| pair[1] - pair[0]).collect();
    // The way that most steps go; where as many go either way, that from the first to the last.
    let up = steps.iter().filter(|step| **step > 0.0).count();
    let sign = match (2 * up).cmp(&steps.len()) {
        std::cmp::Ordering::Greater => 1.0,
        std::cmp::Ordering::Less => -1.0,
        std::cmp::Ordering::Equal => ends.signum(),
    };
    let back = steps.iter().position(|step| sign * step <= 0.0);
    if let Some(i) = back {
        let (next, from) = (groups[i + 1], groups[i][0].d_mm);
        let (line, (last, _, to)) = (next[0].line, figures(&next[next.len() - 1]));
        bail!(
            "lines {line} to {last}: from {from} to {to} mm the centres go back, from about {:.1} to {:.1} \
             px, where the others go on: two distances would have one centre; take a range in which the \
             centre only rises or only falls",
            medians[i],
            medians[i + 1]
        );
    }
    Ok(())
}

/// Five points in a row whose centres go back, each by more than noise makes them.
fn folds(points: &[Point], scatter: &[f64]) -> anyhow::Result<()> {
    let mut sorted: Vec<(&Point, f64)> = points.iter().zip(scatter.iter().copied()).collect();
    sorted.sort_by(|(a, _), (b, _)| a.d_mm.total_cmp(&b.d_mm));
    let sign = median(sorted.windows(2).map(|it| it[1].0.x_px - it[0].0.x_px)).signum();
    let goes_back = |pair: &[(&Point, f64)]| {
        let noise = NOISE * pair[0].1.hypot(pair[1].1);
        sign * (pair[1].0.x_px - pair[0].0.x_px) < -noise
    };
    let mut runs = sorted.windows(FOLD + 1);
    if let Some([(first, _), .., (last, _)]) = runs.find(|run| run.windows(2).all(goes_back)) {
        let [(first, from_px, from), (last, to_px, to)] = [first, last].map(figures);
        bail!(
            "lines {first} to {last}: the centre goes back from {from_px} to {to_px} px while the distance \
             goes on from {from} to {to} mm: two distances would have one centre; take a range in which the \
             centre only rises or only falls"
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_rising_run_is_found() {
        for (numbers, run) in [
            (&[1.0, 2.0, 3.0][..], &[0, 1, 2][..]),
            (&[3.0, 1.0, 2.0, 4.0, 3.5], &[1, 2, 3]),
            (&[-900.0, -800.0, -850.0, -700.0], &[0, 1, 3]),
            (&[2.0, 2.0], &[0]),
            (&[], &[]),
        ] {
            assert_eq!(longest_rise(numbers), run, "{numbers:?}");
        }
    }
}
