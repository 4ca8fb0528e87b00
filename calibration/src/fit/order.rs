//! What makes points no calibration, whatever curve is sought: too few, two with one centre, or centres that
//! go back while distances go on. The order of the lines does not matter.
//!
//! **Centres along the distances** rise or fall. Here noise and outliers do not count, and a fold
//! does: that the centre turns and comes back, so that two distances have one centre. A fold is found where
//! medians of groups of points go back, or five points in a row by more than their scatter. (A lesser one
//! than that is outliers, which are named.)
//!
//! With fewer than ten points nothing can be rejected: any step back counts.

use anyhow::{bail, ensure};
use statistics::{least_and_most, median};

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

/// Looks at the points before any fit: one of each distance, and all of which they are the means.
pub fn before(points: &[Point], all: &[Point]) -> anyhow::Result<()> {
    ensure!(
        points.len() >= 3,
        "there {} in the file, and eq. (1) has three parameters: take three at least, better 20 or more",
        match points.len() {
            0 => "are no points".into(),
            1 => format!("is one distance (line {})", points[0].line),
            count => format!(
                "are {count} distances (lines {} and {})",
                points[0].line, points[1].line
            ),
        }
    );
    repeated(points)?;
    match points.len() < FEWEST_TO_REJECT {
        true => steps_back(points).and_then(|()| strays(points, all)),
        false => groups_go_back(points),
    }
}

/// Two distances with one centre.
fn repeated(points: &[Point]) -> anyhow::Result<()> {
    let mut sorted: Vec<&Point> = points.iter().collect();
    sorted.sort_by(|a, b| a.x_px.total_cmp(&b.x_px).then(a.line.cmp(&b.line)));
    let same = sorted
        .windows(2)
        .filter(|pair| pair[0].x_px == pair[1].x_px);
    if let Some([first, later]) = same.min_by_key(|pair| pair[1].line) {
        let [(line, x_px, _), (later, ..)] = [first, later].map(figures);
        bail!(
            "line {later} has the centre of line {line}, {x_px} px, at another distance: no calibration can \
             tell the two apart; take one of them again, or remove it"
        );
    }
    Ok(())
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

/// The line of a point, its centre and its distance, for a person.
fn figures(point: &&Point) -> (u64, f64, f64) {
    let rounded = |value: f64| (1e5 * value).round() / 1e5;
    (point.line, rounded(point.x_px), rounded(point.d_mm))
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

/// Few distances: the centres of one lie together, within a quarter of the steps between distances.
fn strays(points: &[Point], all: &[Point]) -> anyhow::Result<()> {
    let (least, most) = least_and_most(points.iter().map(|point| point.x_px));
    let near = 0.25 * (most - least) / (points.len() - 1) as f64;
    let strays = |it: &&Point| {
        let is_far = |mean: &Point| mean.d_mm == it.d_mm && (mean.x_px - it.x_px).abs() > near;
        points.iter().any(is_far)
    };
    if let Some((line, x_px, d_mm)) = all.iter().find(strays).as_ref().map(figures) {
        bail!(
            "line {line}: its centre, {x_px} px, is far from those of the other lines with {d_mm} mm: \
             correct one of them, or remove it"
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
        let next = groups[i + 1];
        let (_, _, from) = figures(&groups[i][0]);
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

/// Five points in a row whose centres go back, each by more than noise makes them, when it is known how far
/// centres scatter, in pixels.
pub fn after(points: &[Point], scatter: &[f64]) -> anyhow::Result<()> {
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
