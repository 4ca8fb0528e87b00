//! Eq. (1) to begin with, which no outlier can move: of curves through three points each, that with the least
//! median of residuals (P. Rousseeuw, 1984). It holds as long as more than half of the points are good.

use statistics::median;

use super::eq1::Eq1;
use super::observed::Observed;

/// Curves that are tried. Where a fifth of the points are bad, half of the triples have none of them.
const TRIES: usize = 300;

/// The curve through three points, one from each third of the distances, from which half of the points differ
/// least. `None` where no three points give a curve.
pub fn robust(points: &[Observed]) -> Option<Eq1> {
    let mut by_distance: Vec<&Observed> = points.iter().collect();
    by_distance.sort_by(|a, b| a.distance.total_cmp(&b.distance));
    let third = points.len() / 3;
    let (near, rest) = by_distance.split_at(third);
    let (middle, far) = rest.split_at(rest.len() - third);
    // Numerical Recipes' generator: always the same triples for the same number of points.
    let mut random = 1u32;
    let mut one_of = |part: &[&Observed]| {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let point = part.get((random >> 8) as usize % part.len().max(1))?;
        Some((point.centre, point.distance))
    };
    let curves =
        (0..TRIES).filter_map(|_| Eq1::through([one_of(near)?, one_of(middle)?, one_of(far)?]));
    let judged = curves.map(|curve| {
        let over_sigma = |point: &Observed| (point.residual(&curve) / point.sigma(&curve)).abs();
        (median(points.iter().map(over_sigma)), curve)
    });
    let best = judged.min_by(|(a, _), (b, _)| a.total_cmp(b));
    best.map(|(_, curve)| curve)
}
