//! Interpolation in f64.

/// The cubic's value in f64: PCHIP after F. Fritsch and J. Butland with scipy's ends, but a slope is at most
/// 1.5 times the lesser secant (`most`) and at an end at least half (`least`).
pub fn pchip(knots: &[(f64, f64)], x: f64, least: f64, most: f64) -> f64 {
    let lengths: Vec<f64> = knots.windows(2).map(|k| k[1].0 - k[0].0).collect();
    let secants = knots
        .windows(2)
        .map(|k| (k[1].1 - k[0].1) / (k[1].0 - k[0].0));
    let secants: Vec<f64> = secants.collect();
    let end = |i: usize, next: Option<usize>| {
        let Some(next) = next else { return secants[i] };
        let (h, g) = (lengths[i], lengths[next]);
        let slope = ((2.0 * h + g) * secants[i] - h * secants[next]) / (h + g);
        (slope / secants[i]).clamp(least, most) * secants[i]
    };
    let slope = |i: usize| {
        if i == 0 {
            return end(0, (secants.len() > 1).then_some(1));
        }
        if i == secants.len() {
            return end(i - 1, i.checked_sub(2));
        }
        let (h, g) = (lengths[i - 1], lengths[i]);
        let (s, t) = (secants[i - 1], secants[i]);
        if s * t <= 0.0 {
            return 0.0;
        }
        let mean = 3.0 * (h + g) / ((2.0 * g + h) / s + (g + 2.0 * h) / t);
        let lesser = if s.abs() < t.abs() { s } else { t };
        (mean / lesser).min(most) * lesser
    };
    let after = knots.partition_point(|k| k.0 <= x);
    let i = after.clamp(1, knots.len() - 1) - 1;
    let (h, t) = (lengths[i], (x - knots[i].0) / lengths[i]);
    let rise = knots[i + 1].1 - knots[i].1;
    let (m, n) = (slope(i) * h, slope(i + 1) * h);
    knots[i].1 + t * (m + t * (3.0 * rise - 2.0 * m - n + t * (m + n - 2.0 * rise)))
}
