//! Eq. (1) fitted to centres whose distances are known, by weighted least squares of the distance.
//!
//! d0 + b tan(u - atan(x/f)) = D + K/(x - xp): the paper's four parameters make a curve that has three (see
//! [`slitrange::distance::eq1`]), so three are fitted. (d0, u, b, f) cannot be told from data.
//!
//! **Scaling.** With z = (x - xc)/h, which goes from -1 to 1 over the data, the same curve is d = (p + q
//! z)/(1 + r z). The condition number of its derivatives is 19 over the paper's range, that of the
//! derivatives by (D, K, xp) 271. It is fitted in that form, and D = q/r, xp = xc - h/r, K = (p - q/r) h/r
//! come out of it.
//!
//! **Start.** d = p + q z - r z d is linear in p, q and r. Its least squares weigh the errors of the distance
//! by 1 + r z, which is within some per cent of the best already; Gauss-Newton steps do the rest.

use anyhow::{Context as _, ensure};
use nalgebra::{Matrix3, RowVector3, Vector3};
use statistics::least_and_most;

/// Eq. (1) as d = D + K/(x - xp), in metres and pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eq1 {
    /// D in metres: the distance at which the centre would run to infinity.
    pub d: f64,
    /// K in metre pixels.
    pub k: f64,
    /// xp in pixels: the centre at which the distance would be infinite.
    pub pole: f64,
}

impl Eq1 {
    /// Distance in metres for a centre in pixels.
    pub fn distance(&self, centre: f64) -> f64 {
        self.d + self.k / (centre - self.pole)
    }

    /// Centre in pixels for a distance in metres.
    pub fn centre(&self, distance: f64) -> f64 {
        self.pole + self.k / (distance - self.d)
    }

    /// Metres a pixel at a centre in pixels.
    pub fn slope(&self, centre: f64) -> f64 {
        -self.k / (centre - self.pole).powi(2)
    }

    /// The curve through three points, where there is one with its pole beyond them.
    pub fn through(points: [(f64, f64); 3]) -> Option<Self> {
        let scale = Scale::of(&points.map(Observation::from)).ok()?;
        let row = |(x, d): (f64, f64)| RowVector3::new(1.0, scale.z(x), -scale.z(x) * d);
        let matrix = Matrix3::from_rows(&points.map(row));
        let scaled = matrix.lu().solve(&Vector3::from(points.map(|(_, d)| d)))?;
        (scaled[2].abs() < 1.0 && scaled[2].abs() > STRAIGHT).then(|| scale.eq1(&scaled))
    }
}

/// A centre at a known distance, and what its residual counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// In pixels.
    pub centre: f64,
    /// In metres.
    pub distance: f64,
    /// The variance of the distance less the curve's, in square metres or in a unit of its own.
    pub variance: f64,
}

impl From<(f64, f64)> for Observation {
    fn from((centre, distance): (f64, f64)) -> Self {
        Self {
            centre,
            distance,
            variance: 1.0,
        }
    }
}

/// What a fit gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The curve.
    pub curve: Eq1,
    /// The first and the last centre in pixels. The curve is known between them.
    pub valid: (f64, f64),
    /// Covariance of (D, K, xp) as the variances of the points tell it, in the squares and products of their
    /// units: for errors that are independent. Errors that neighbours share, as speckle makes them, leave the
    /// parameters less certain.
    pub unit_covariance: Matrix3<f64>,
    scale: Scale,
    scaled: Vector3<f64>,
    /// Covariance of (p, q, r), likewise.
    unit_scaled: Matrix3<f64>,
}

impl Fit {
    /// The variance of the curve's distance at a centre, as the variances of the points tell it.
    pub fn unit_variance_at(&self, centre: f64) -> f64 {
        let (_, gradient) = self.scale.distance(&self.scaled, centre);
        (gradient * self.unit_scaled * gradient.transpose())[0]
    }

    /// r over its standard uncertainty, as the variances of the points tell it: where it is not well above 1,
    /// a straight line does as well.
    pub fn unit_bend(&self) -> f64 {
        self.scaled[2].abs() / self.unit_scaled[(2, 2)].sqrt()
    }
}

/// Steps at most; three are usual, because the start is within some per cent.
const MAX_STEPS: usize = 50;
/// |r| below which points lie on a straight line to within rounding: the pole is 1e9 ranges away.
const STRAIGHT: f64 = 1e-9;

/// Fits the curve to centres in pixels and their distances in metres, all with the same variance.
pub fn fit(points: &[(f64, f64)]) -> anyhow::Result<Fit> {
    let points: Vec<Observation> = points.iter().copied().map(Observation::from).collect();
    fit_weighted(&points)
}

/// Fits the curve.
///
/// # Errors
/// There are fewer than three points or centres; a number is not finite; the points lie on a straight line,
/// whose pole is at infinity; or the curve that fits best has its pole among the points.
pub fn fit_weighted(points: &[Observation]) -> anyhow::Result<Fit> {
    ensure!(
        points.len() >= 3,
        "{} points: eq. (1) has three parameters and needs three at least",
        points.len()
    );
    let is_finite = |point: &Observation| point.centre.is_finite() && point.distance.is_finite();
    let not_finite = "a centre or a distance is not a finite number";
    ensure!(points.iter().all(is_finite), not_finite);
    let scale = Scale::of(points)?;
    let mut scaled = scale.start(points)?;
    let mut squares = scale.squares(points, &scaled);
    for _ in 0..MAX_STEPS {
        let (normal, right) = scale.step(points, &scaled);
        let step = normal.cholesky().context(UNDETERMINED)?.solve(&right);
        // Halved until it leads downhill: far from the minimum a whole step may cross a pole.
        let shorter = (0..30).map(|halvings| scaled + step * 0.5f64.powi(halvings));
        let better = shorter
            .map(|scaled| (scaled, scale.squares(points, &scaled)))
            .find(|&(_, lower)| lower < squares);
        // Where no step leads further down, rounding is all that is left.
        let Some((next, lower)) = better else { break };
        let gained = squares - lower;
        (scaled, squares) = (next, lower);
        if gained < 1e-13 * squares {
            break;
        }
    }
    ensure!(
        scaled[2].abs() > STRAIGHT,
        "the points lie on a straight line, for which eq. (1) has no finite parameters: check the distances, \
         or take a wider range of them"
    );
    ensure!(
        scaled[2].abs() < 1.0,
        "the curve that fits best has its pole at pixel {:.1}, among the centres from {:.1} to {:.1}: these \
         are no centres of one target that moves",
        scale.eq1(&scaled).pole,
        scale.first,
        scale.last
    );
    let (normal, _) = scale.step(points, &scaled);
    let by_scaled = scale.derivatives_of_eq1(&scaled);
    let inverse = normal.cholesky().context(UNDETERMINED)?.inverse();
    let curve = scale.eq1(&scaled);
    Ok(Fit {
        curve,
        valid: (scale.first, scale.last),
        unit_covariance: by_scaled * inverse * by_scaled.transpose(),
        scale,
        scaled,
        unit_scaled: inverse,
    })
}

const UNDETERMINED: &str = "the points do not determine three parameters";

/// Normal equations: `row` gives a point's derivatives, and the value that they are to explain.
fn normal_equations(
    points: &[Observation],
    row: impl Fn(&Observation) -> (RowVector3<f64>, f64),
) -> (Matrix3<f64>, Vector3<f64>) {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for point in points {
        let (row, value) = row(point);
        let weighted = row.transpose() / point.variance;
        normal += weighted * row;
        right += weighted * value;
    }
    (normal, right)
}

/// z = (x - middle) / half.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Scale {
    first: f64,
    last: f64,
    middle: f64,
    half: f64,
}

impl Scale {
    fn of(points: &[Observation]) -> anyhow::Result<Self> {
        let centres = || points.iter().map(|point| point.centre);
        let (first, last) = least_and_most(centres());
        ensure!(
            centres().any(|x| x != first && x != last),
            "all centres are the same, or one of two: three parameters need three at least"
        );
        Ok(Self {
            first,
            last,
            middle: 0.5 * (first + last),
            half: 0.5 * (last - first),
        })
    }

    fn z(&self, centre: f64) -> f64 {
        (centre - self.middle) / self.half
    }

    /// p, q and r by linear least squares of d = p + q z - r z d.
    fn start(&self, points: &[Observation]) -> anyhow::Result<Vector3<f64>> {
        let (normal, right) = normal_equations(points, |point| {
            let z = self.z(point.centre);
            (RowVector3::new(1.0, z, -z * point.distance), point.distance)
        });
        Ok(normal.cholesky().context(UNDETERMINED)?.solve(&right))
    }

    /// The distance at a centre, and its derivatives by p, q and r.
    fn distance(&self, scaled: &Vector3<f64>, centre: f64) -> (f64, RowVector3<f64>) {
        let z = self.z(centre);
        let below = 1.0 / (1.0 + scaled[2] * z);
        let distance = (scaled[0] + scaled[1] * z) * below;
        let gradient = RowVector3::new(below, z * below, -z * distance * below);
        (distance, gradient)
    }

    /// The sum of the residuals' squares over their variances; infinite where the pole is among the centres.
    fn squares(&self, points: &[Observation], scaled: &Vector3<f64>) -> f64 {
        if scaled[2].abs() >= 1.0 {
            return f64::INFINITY;
        }
        let residual = |point: &Observation| self.distance(scaled, point.centre).0 - point.distance;
        let squares = points.iter().map(|it| residual(it).powi(2) / it.variance);
        squares.sum()
    }

    /// The normal equations of a Gauss-Newton step.
    fn step(&self, points: &[Observation], scaled: &Vector3<f64>) -> (Matrix3<f64>, Vector3<f64>) {
        normal_equations(points, |point| {
            let (distance, gradient) = self.distance(scaled, point.centre);
            (gradient, point.distance - distance)
        })
    }

    fn eq1(&self, scaled: &Vector3<f64>) -> Eq1 {
        let [p, q, r] = [scaled[0], scaled[1], scaled[2]];
        Eq1 {
            d: q / r,
            k: (p - q / r) * self.half / r,
            pole: self.middle - self.half / r,
        }
    }

    /// Of (D, K, xp) by (p, q, r), row by row.
    fn derivatives_of_eq1(&self, scaled: &Vector3<f64>) -> Matrix3<f64> {
        let [p, q, r] = [scaled[0], scaled[1], scaled[2]];
        let (h, rr) = (self.half, r * r);
        Matrix3::from_rows(&[
            RowVector3::new(0.0, 1.0 / r, -q / rr),
            RowVector3::new(h / r, -h / rr, h * (2.0 * q / r - p) / rr),
            RowVector3::new(0.0, 0.0, h / rr),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution as _, StandardNormal};
    use simulator::optics::Optics;

    /// The paper's range on the paper's pixels.
    fn exact(count: usize) -> Vec<(f64, f64)> {
        let optics = Optics {
            offset: 0.012,
            pitch: 5.86e-6,
            axis: 959.5,
            ..Optics::nominal()
        };
        let distances = (0..count).map(|i| 0.60 + 0.42 * i as f64 / (count - 1) as f64);
        distances.map(|it| (optics.centre(it), it)).collect()
    }

    /// D = d0 - b/t, xp = axis - f/t, K = b f (1 + t^2)/t^2, with t = tan u = 2.6.
    #[test]
    fn recovers_the_exact_curve() {
        let found = fit(&exact(50)).expect("a fit");
        let focal_length = 0.05 / 5.86e-6;
        let [d, k, pole] = [
            0.012 - 0.3 / 2.6,
            0.3 * focal_length * (1.0 + 2.6 * 2.6) / (2.6 * 2.6),
            959.5 - focal_length / 2.6,
        ];
        println!("{:?} against {:?}", found.curve, (d, k, pole));
        assert!((found.curve.d / d - 1.0).abs() < 1e-9);
        assert!((found.curve.k / k - 1.0).abs() < 1e-9);
        assert!((found.curve.pole / pole - 1.0).abs() < 1e-9);
        for (centre, distance) in exact(50) {
            assert!((found.curve.distance(centre) - distance).abs() < 1e-12);
        }
    }

    /// The scaled form is well-conditioned. The form in (D, K, xp) is not.
    #[test]
    fn the_scaled_form_is_well_conditioned() {
        let points: Vec<Observation> = exact(1000).into_iter().map(Observation::from).collect();
        let scale = Scale::of(&points).expect("a scale");
        let scaled = scale.start(&points).expect("a start");
        // The singular values of the derivatives, columns of unit length, are the roots of N's eigenvalues.
        let condition = |normal: Matrix3<f64>| {
            let unit = Matrix3::from_diagonal(&normal.diagonal().map(|value| 1.0 / value.sqrt()));
            let eigenvalues = (unit * normal * unit).symmetric_eigenvalues();
            (eigenvalues.max() / eigenvalues.min()).sqrt()
        };
        let (normal, _) = scale.step(&points, &scaled);
        let to_eq1 = scale.derivatives_of_eq1(&scaled).try_inverse();
        let to_eq1 = to_eq1.expect("independent");
        let [fitted, physical] = [normal, to_eq1.transpose() * normal * to_eq1].map(condition);
        println!("condition {fitted:.1}, in (D, K, xp) {physical:.0}");
        assert!(fitted < 20.0 && physical > 10.0 * fitted);
    }

    /// Compares the covariance with the scatter of 2000 fits of 40 points with errors of 20 um.
    #[test]
    fn the_covariance_agrees_with_the_scatter_of_many_fits() {
        const FITS: usize = 2000;
        let points = exact(40);
        let mut random = ChaCha8Rng::seed_from_u64(11);
        let mut one_fit = || {
            let noise: [f64; 40] = std::array::from_fn(|_| StandardNormal.sample(&mut random));
            let noisy = points.iter().zip(noise);
            let noisy: Vec<_> = noisy.map(|(&(x, d), it)| (x, d + 20e-6 * it)).collect();
            let found = fit(&noisy).expect("a fit");
            let off = noisy.iter().map(|(x, d)| found.curve.distance(*x) - d);
            let variance = off.map(|off| off * off).sum::<f64>() / 37.0;
            (found, variance)
        };
        let (fits, variances): (Vec<Fit>, Vec<f64>) = (0..FITS).map(|_| one_fit()).unzip();
        let parameters = |fit: &Fit| Vector3::new(fit.curve.d, fit.curve.k, fit.curve.pole);
        let sum: Vector3<f64> = fits.iter().map(parameters).sum();
        let mean = sum / FITS as f64;
        let square = |fit: &Fit| (parameters(fit) - mean) * (parameters(fit) - mean).transpose();
        let scatter = fits.iter().map(square).sum::<Matrix3<f64>>() / (FITS - 1) as f64;
        let claimed = (fits.iter().zip(&variances)).map(|(it, by)| it.unit_covariance * *by);
        let claimed = claimed.sum::<Matrix3<f64>>() / FITS as f64;
        for i in 0..3 {
            let ratio = (claimed[(i, i)] / scatter[(i, i)]).sqrt();
            println!(
                "parameter {i}: {:.3e} +- {:.1e}, claimed over found {ratio:.3}",
                mean[i],
                scatter[(i, i)].sqrt()
            );
            // A standard deviation of 2000 values is known to 1.6 %.
            assert!((ratio - 1.0).abs() < 0.05);
            for j in 0..i {
                let correlation = |m: &Matrix3<f64>| m[(i, j)] / (m[(i, i)] * m[(j, j)]).sqrt();
                let [claimed, found] = [correlation(&claimed), correlation(&scatter)];
                assert!((claimed - found).abs() < 0.01, "{i} {j}: {claimed} {found}");
            }
        }
        let deviation = statistics::mean(variances.iter().map(|it| it.sqrt()));
        // The mean of a deviation of 37 degrees of freedom is 1 - 1/(4 * 37) of the true one.
        println!("deviation {:.3} um", deviation * 1e6);
        assert!((deviation / 20e-6 - (1.0 - 1.0 / 148.0)).abs() < 0.01);
    }

    #[test]
    fn points_without_a_curve_are_refused_with_a_reason() {
        let error = |points: &[(f64, f64)]| fit(points).expect_err("no curve").to_string();
        let points = |distance: fn(f64) -> f64| -> Vec<(f64, f64)> {
            (0..10).map(|x| (x.into(), distance(x.into()))).collect()
        };
        let two: Vec<(f64, f64)> = (0..10).map(|i| (f64::from(i % 2), f64::from(i))).collect();
        for (points, reason) in [
            (&[(1.0, 2.0); 2][..], "2 points"),
            (&[(1.0, 2.0); 9], "the same"),
            (&[(1.0, f64::NAN); 9], "finite"),
            (&two, "one of two"),
            (&points(|x| 1.0 + x), "straight"),
            (&points(|x| 1.0 + 1.0 / (x - 4.3)), "pole"),
        ] {
            assert!(error(points).contains(reason), "{}", error(points));
        }
    }
}
