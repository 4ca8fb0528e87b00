//! Points at one distance: taken again, or on the way up and on the way down.
//!
//! They share the error of their position, so they count as one point, their mean. Their scatter tells the
//! noise of a centre, and the difference of the two ways tells the stage's backlash.

use serde::Serialize;
use statistics::{mean, rms, variance};

use super::eq1::Eq1;
use crate::points::Point;

/// What repeated points tell.
#[derive(Clone, Debug, Serialize)]
pub struct Repeats {
    /// Points beyond the first of their distance.
    pub repeats: usize,
    /// The standard deviation of a point among those of its distance and way, in pixels and as a distance.
    pub scatter_px: Option<f64>,
    /// In millimetres.
    pub scatter_mm: Option<f64>,
    /// By how much the centres say that a distance is larger on the way up than on the way down, in
    /// millimetres. The second number is its standard uncertainty, from the scatter of the points.
    pub backlash_mm: Option<(f64, f64)>,
}

/// The points of each distance, and whether the target was on its way up. None where it turned.
fn groups(points: &[Point]) -> Vec<Vec<(Option<bool>, Point)>> {
    let way = |(index, point): (usize, &Point)| {
        let differs = |other: &&Point| other.d_mm != point.d_mm;
        let before = points[..index].iter().rev().find(differs);
        let before = before.map(|it| it.d_mm < point.d_mm);
        let after = points[index..].iter().find(differs);
        let after = after.map(|it| it.d_mm > point.d_mm);
        (before.filter(|_| before == after), *point)
    };
    let mut came: Vec<(Option<bool>, Point)> = points.iter().enumerate().map(way).collect();
    came.sort_by(|(way, a), (other, b)| a.d_mm.total_cmp(&b.d_mm).then(way.cmp(other)));
    let groups = came.chunk_by(|(_, a), (_, b)| a.d_mm == b.d_mm);
    groups.map(<[_]>::to_vec).collect()
}

/// One point for each distance, in the order of the lines.
pub fn merged(points: &[Point]) -> Vec<Point> {
    let one = |group: Vec<(Option<bool>, Point)>| {
        let of = |value: fn(&Point) -> Option<f64>| -> Option<Vec<f64>> {
            group.iter().map(|(_, point)| value(point)).collect()
        };
        let first = group.iter().map(|(_, point)| *point);
        let first = first.min_by_key(|point| point.line)?;
        Some(match group.len() {
            1 => first,
            count => Point {
                x_px: mean(group.iter().map(|(_, point)| point.x_px)),
                sigma_px: of(|it| it.sigma_px).map(|it| rms(&it) / (count as f64).sqrt()),
                height_counts: of(|it| it.height_counts).map(|it| mean(&it)),
                ..first
            },
        })
    };
    let mut merged: Vec<Point> = groups(points).into_iter().filter_map(one).collect();
    merged.sort_by_key(|point| point.line);
    merged
}

impl Repeats {
    /// What points tell by their curve. None if each has a distance of its own.
    pub fn of(points: &[Point], curve: &Eq1) -> Option<Self> {
        let groups = groups(points);
        let repeats = points.len() - groups.len();
        let mm = |point: &Point| 1e3 * curve.distance(point.x_px);
        let scatter = |value: &dyn Fn(&Point) -> f64| {
            let ways = groups
                .iter()
                .flat_map(|it| it.chunk_by(|(a, _), (b, _)| a == b));
            let (mut squares, mut freedom) = (0.0, 0.0);
            for way in ways.filter(|way| way.len() > 1 && way[0].0.is_some()) {
                let values: Vec<f64> = way.iter().map(|(_, point)| value(point)).collect();
                let free = values.len() as f64 - 1.0;
                (squares, freedom) = (squares + free * variance(&values), freedom + free);
            }
            (freedom > 0.0).then(|| (squares / freedom).sqrt())
        };
        let apart = groups.iter().filter_map(|group| {
            let [down, up] = [false, true].map(|wanted| {
                let of_way = group.iter().filter(move |(way, _)| *way == Some(wanted));
                let of_way: Vec<f64> = of_way.map(|(_, point)| mm(point)).collect();
                (!of_way.is_empty()).then(|| mean(&of_way))
            });
            Some(up? - down?)
        });
        let apart: Vec<f64> = apart.collect();
        (repeats > 0).then(|| Self {
            repeats,
            scatter_px: scatter(&|point| point.x_px),
            scatter_mm: scatter(&mm),
            backlash_mm: (apart.len() > 1)
                .then(|| (mean(&apart), (variance(&apart) / apart.len() as f64).sqrt())),
        })
    }
}
