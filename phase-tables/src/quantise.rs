//! The weights as integers.

use std::fmt::Write as _;

use nalgebra::DVector;

use crate::design::{Shape, Table};

/// The largest sample that a table is proven for: eight pixels of a 12-bit converter, 8 * 4095. Sums of more are halved.
pub const LARGEST_SAMPLE: i64 = 32_760;

/// A table in 16-bit integers. Weights are stored phase after phase, `2 * half_width + 1` a phase.
#[derive(Clone, Debug)]
pub struct IntegerTable {
    /// What the table is for.
    pub shape: Shape,
    /// Weights of the score.
    pub score: Vec<i16>,
    /// Weights of its slope.
    pub slope: Vec<i16>,
    /// Weights of the stretch.
    pub stretch: Vec<i16>,
    /// Samples that (integer) score / slope = 1 stands for.
    pub centre_per_ratio: f64,
    /// Relative excess of width that stretch / slope = 1 stands for.
    pub stretch_per_ratio: f64,
    /// Height of the spot in counts that slope = 1 stands for.
    pub height_per_slope: f64,
    /// Variance of the centre in samples squared, times slope squared, for noise of one count squared in every sample.
    pub variance_per_noise: f64,
    /// The same for a spot one electron high whose samples have its shot noise, in counts of one electron.
    pub variance_per_height: f64,
}

impl Table {
    /// Rounds to integers with one scale a kind of weight, as large as the proof of no overflow allows:
    /// sum |weight| * [`LARGEST_SAMPLE`] < 2^31 and |weight| < 2^15. Rows still sum to zero exactly.
    pub fn quantise(&self) -> IntegerTable {
        let (score, score_scale) = integers(&self.score, Some(&self.profile));
        let (slope, slope_scale) = integers(&self.slope, None);
        let (stretch, stretch_scale) = integers(&self.stretch, Some(&self.profile));
        let taps = self.shape.taps();
        let phases = self.shape.phases as f64;
        let (mut per_noise, mut per_height, mut response) = (0.0, 0.0, 0.0);
        for (k, profile) in self.profile.iter().enumerate() {
            for (i, light) in profile.iter().enumerate() {
                let weight = f64::from(score[k * taps + i]) / score_scale;
                per_noise += weight * weight / phases;
                per_height += weight * weight * light / phases;
                response += f64::from(slope[k * taps + i]) * light / phases;
            }
        }
        IntegerTable {
            shape: self.shape,
            score,
            slope,
            stretch,
            centre_per_ratio: slope_scale / score_scale,
            stretch_per_ratio: slope_scale / stretch_scale,
            height_per_slope: 1.0 / response,
            variance_per_noise: per_noise * slope_scale * slope_scale,
            variance_per_height: per_height * slope_scale * slope_scale,
        }
    }
}

/// Integer weights and the scale that was used.
fn integers(rows: &[DVector<f64>], profile: Option<&[DVector<f64>]>) -> (Vec<i16>, f64) {
    let largest_sum = rows.iter().map(|row| row.lp_norm(1)).fold(0.0, f64::max);
    let largest = rows.iter().map(|row| row.amax()).fold(0.0, f64::max);
    let bound = f64::from(i32::MAX) / LARGEST_SAMPLE as f64;
    // A thousandth is left for the rounding.
    let scale = (bound / largest_sum).min(f64::from(i16::MAX) / largest) * 0.999;
    let mut weights = vec![];
    for (k, row) in rows.iter().enumerate() {
        let exact: Vec<f64> = row.iter().map(|weight| weight * scale).collect();
        let mut rounded: Vec<i64> = exact.iter().map(|weight| weight.round() as i64).collect();
        make_sum_zero(&mut rounded, &exact);
        if let Some(profile) = profile {
            make_response_zero(&mut rounded, &profile[k]);
        }
        assert_eq!(
            rounded.iter().sum::<i64>(),
            0,
            "rounding leaves at most half a unit a weight"
        );
        assert!(
            rounded.iter().map(|weight| weight.abs()).sum::<i64>() * LARGEST_SAMPLE
                <= i64::from(i32::MAX)
        );
        weights.extend(
            rounded
                .into_iter()
                .map(|weight| i16::try_from(weight).expect("scaled to fit 16 bits")),
        );
    }
    (weights, scale)
}

/// Takes the rounding's sum away where it costs least: at the weights whose rounding went furthest the other way.
fn make_sum_zero(rounded: &mut [i64], exact: &[f64]) {
    let excess: i64 = rounded.iter().sum();
    let step = excess.signum();
    let mut order: Vec<usize> = (0..rounded.len()).collect();
    let error = |i: usize| (rounded[i] as f64 - exact[i]) * step as f64;
    order.sort_by(|&a, &b| error(b).total_cmp(&error(a)));
    for i in order.into_iter().take(excess.unsigned_abs() as usize) {
        rounded[i] -= step;
    }
}

/// Brings the response to a spot at the phase itself to zero, which would be a bias: one unit is moved from a weight to
/// another, which keeps the sum, as long as that helps. No weight is moved twice.
fn make_response_zero(rounded: &mut [i64], profile: &DVector<f64>) {
    let mut free = vec![true; rounded.len()];
    loop {
        let response: f64 = rounded
            .iter()
            .zip(profile)
            .map(|(&weight, light)| weight as f64 * light)
            .sum();
        let best = (0..rounded.len())
            .flat_map(|up| (0..rounded.len()).map(move |down| (up, down)))
            .filter(|&(up, down)| up != down && free[up] && free[down])
            .map(|(up, down)| ((response + profile[up] - profile[down]).abs(), up, down))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match best {
            Some((left, up, down)) if left < response.abs() => {
                rounded[up] += 1;
                rounded[down] -= 1;
                (free[up], free[down]) = (false, false);
            }
            _ => return,
        }
    }
}

/// Rust source of an array of the core's `Table`s.
pub fn rust_source(tables: &[IntegerTable]) -> String {
    let mut source = format!("[Table<'static>; {}] = [\n", tables.len());
    for table in tables {
        // Writing to a String cannot fail.
        let _ = writeln!(
            source,
            "Table {{ width: {:?}, half_width: {}, phases: {}, score: &{:?}, slope: &{:?}, stretch: &{:?}, \
             centre_per_ratio: {:?}, stretch_per_ratio: {:?}, height_per_slope: {:?}, variance_per_noise: {:?}, \
             variance_per_height: {:?} }},",
            table.shape.width as f32,
            table.shape.half_width,
            table.shape.phases,
            table.score,
            table.slope,
            table.stretch,
            table.centre_per_ratio as f32,
            table.stretch_per_ratio as f32,
            table.height_per_slope as f32,
            table.variance_per_noise as f32,
            table.variance_per_height as f32,
        );
    }
    source.push(']');
    source
}

#[cfg(test)]
mod tests {
    use crate::{DEFAULT_NOISE_RATIO, gaussian, set};

    #[test]
    fn every_row_of_weights_sums_to_zero_and_cannot_overflow() {
        for noise_ratio in [DEFAULT_NOISE_RATIO, f64::INFINITY, 0.01] {
            let tables = set(&gaussian, noise_ratio);
            let mut weights = 0;
            for table in &tables {
                let taps = table.shape.taps();
                for rows in [&table.score, &table.slope, &table.stretch] {
                    weights += rows.len();
                    for row in rows.chunks(taps) {
                        assert_eq!(row.iter().map(|&weight| i64::from(weight)).sum::<i64>(), 0);
                        let worst: i64 = row
                            .iter()
                            .map(|&weight| i64::from(weight).abs() * super::LARGEST_SAMPLE)
                            .sum();
                        assert!(worst <= i64::from(i32::MAX));
                    }
                    // A scale that wastes bits would pass the proof and lose accuracy.
                    let sums = rows.chunks(taps).map(|row| {
                        row.iter()
                            .map(|&weight| i64::from(weight).abs())
                            .sum::<i64>()
                    });
                    let of_sums = sums.max().unwrap_or(0) as f64 * super::LARGEST_SAMPLE as f64
                        / f64::from(i32::MAX);
                    let of_weights = rows
                        .iter()
                        .map(|weight| weight.unsigned_abs())
                        .max()
                        .unwrap_or(0);
                    let used = of_sums.max(f64::from(of_weights) / f64::from(i16::MAX));
                    assert!(
                        used > 0.99,
                        "width {}: {used} of the range is used",
                        table.shape.width
                    );
                }
            }
            println!("r = {noise_ratio}: {} bytes of weights", 2 * weights);
            assert!(2 * weights <= 10_000);
        }
    }

    /// On a noiseless spot of exactly the table's width, score / slope is the distance.
    #[test]
    fn ratio_is_the_distance() {
        for table in set(&gaussian, DEFAULT_NOISE_RATIO) {
            let taps = table.shape.taps();
            let mut worst = 0.0f64;
            for k in 0..table.shape.phases {
                for step in -10..=10 {
                    let shift = f64::from(step) / 10.0 * 0.5 / table.shape.phases as f64;
                    let at = |i: usize| {
                        gaussian(
                            i as f64 - table.shape.half_width as f64 - table.shape.phase(k) - shift,
                            table.shape.width,
                        )
                    };
                    let dot = |weights: &[i16]| {
                        (0..taps)
                            .map(|i| f64::from(weights[k * taps + i]) * at(i))
                            .sum::<f64>()
                    };
                    let ratio = dot(&table.score) / dot(&table.slope) * table.centre_per_ratio;
                    worst = worst.max((ratio - shift).abs());
                }
            }
            println!(
                "width {:.2}: ratio off by {worst:.1e} px at most",
                table.shape.width
            );
            assert!(worst < 3e-4, "width {}: {worst}", table.shape.width);
        }
    }
}
