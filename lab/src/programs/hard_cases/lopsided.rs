//! Where the centre of a lopsided spot lies between its peak and its centroid, and whether u says so.

use std::fmt::Write as _;

use judges::frames::{measure_rows, words};
use slitrange::Options;
use slitrange::sensor_heads::tcd1304dg;

use crate::prelude::*;

/// The table's tool.
pub const TOOL: &str = "cargo hard-cases, lopsided spots";

/// The light of a spot at a distance from its middle, in widths.
type Light = fn(f64) -> f64;

/// The spot's width in pixels, its height and the read noise in counts.
const WIDTH: f64 = 8.0;
const HEIGHT: f64 = 2500.0;
const READ_NOISE: f64 = 4.0;
const FRAMES: u32 = 64;
const ROWS: u32 = 16;
const ESTIMATORS: [Estimator; 3] = [
    Estimator::Adaptive,
    Estimator::PhaseTable,
    Estimator::GaussNewton,
];

fn gaussian(u: f64) -> f64 {
    (-0.5 * u * u).exp()
}

const SHAPES: [(&str, Light); 6] = [
    ("symmetric", gaussian),
    ("laser with a skewness of 0.1", |u| {
        gaussian(u) * (1.0 + 0.1 / 6.0 * (u * u * u - 3.0 * u))
    }),
    ("laser with a skewness of 0.3", |u| {
        gaussian(u) * (1.0 + 0.3 / 6.0 * (u * u * u - 3.0 * u))
    }),
    ("right flank 20 % wider", |u| {
        gaussian(if u > 0.0 { u / 1.2 } else { u })
    }),
    ("second lobe of 30 % at 1.5 widths", |u| {
        gaussian(u) + 0.3 * gaussian(u - 1.5)
    }),
    ("target that lets light in, tail of 5 %", |u| {
        gaussian(u) + 0.05 * (-u.max(0.0) / 2.0).exp() * gaussian(u.min(0.0))
    }),
];

/// Peak and centroid in widths, on a grid of a thousandth.
fn peak_and_centroid(light: Light) -> [f64; 2] {
    let grid = || (-12_000..=12_000).map(|step| f64::from(step) * 1e-3);
    let peak = grid().max_by(|a, b| light(*a).total_cmp(&light(*b)));
    let sum: f64 = grid().map(light).sum();
    let moment: f64 = grid().map(|u| u * light(u)).sum();
    [peak.expect("a grid"), moment / sum]
}

/// What an estimator makes of a shape: the mean centre and the mean of u, in pixels from the spot's middle.
fn found(light: Light, estimator: Estimator) -> [f64; 2] {
    let geometry = tcd1304dg();
    let shot = f64::from(geometry.shot_variance_per_count_q16) / 65536.0;
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let (mut centres, mut variances) = (0.0, 0.0);
    for frame in 0..FRAMES {
        let middle = 1700.0 + 0.173 * f64::from(frame);
        let mut row = || {
            let row = (0..geometry.words).map(|word| {
                let pixel = word as f64 - geometry.light.start as f64;
                let light = match geometry.light.contains(&word) {
                    true => light((pixel - middle) / WIDTH),
                    false => 0.0,
                };
                let counts = HEIGHT * light;
                let noise: f64 = StandardNormal.sample(&mut random);
                let deviation = (READ_NOISE * READ_NOISE + shot * counts.max(0.0)).sqrt();
                (300.0 + counts + noise * deviation) as f32
            });
            words(&row.collect::<Vec<_>>(), &geometry)
        };
        let rows: Vec<_> = (0..ROWS).map(|_| row()).collect();
        let options = with(Options::default(), |it| it.estimator = estimator);
        let measured = measure_rows(&rows, &geometry, options, None).expect("a reading");
        let frame = measured.frame;
        let by_shape = estimator.by_shape(&frame.shape, None).to_f64();
        centres += frame.centre.to_f64() - middle;
        variances += by_shape.powi(2) + frame.uncertainty.to_f64().powi(2);
        assert!(2 * frame.misfits < frame.rows_used, "u says what it should");
    }
    let frames = f64::from(FRAMES);
    [centres / frames, (variances / frames).sqrt()]
}

/// The table of docs/uncertainty.md.
pub fn markdown() -> String {
    let mut text = format!(
        "Simulated on a PC: {FRAMES} frames of {ROWS} rows of each spot, {WIDTH} pixels wide and \
         {HEIGHT} counts high, on a sensor that was never calibrated. Pixels from the peak to the \
         centroid, and from the peak to the centre of each estimator, with the noise's and the shape's part of u.\n\n\
         | spot | centroid |"
    );
    for estimator in ESTIMATORS {
        _ = write!(text, " `{}` | u |", estimator.name());
    }
    text.push_str("\n|---|---:|---:|---:|---:|---:|---:|---:|\n");
    for (name, light) in SHAPES {
        let [peak, centroid] = peak_and_centroid(light);
        _ = write!(text, "| {name} | {:.2} |", (centroid - peak) * WIDTH);
        for estimator in ESTIMATORS {
            let [centre, u] = found(light, estimator);
            _ = write!(text, " {:.2} | {u:.2} |", centre - peak * WIDTH);
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The estimators that a user chooses for their accuracy lie between peak and centroid, to 0.02 pixels,
    /// and neither end is further off than 2u.
    #[test]
    fn u_covers_the_span_from_peak_to_centroid() {
        for (name, light) in SHAPES {
            let ends = peak_and_centroid(light).map(|it| it * WIDTH);
            for estimator in ESTIMATORS {
                let [centre, u] = found(light, estimator);
                let off = ends.map(|end| (centre - end).abs());
                println!("{name}: {centre:.3} of {ends:.3?}, u {u:.3}");
                let most = (ends[1] - ends[0]).abs() + 0.04;
                assert!(off[0] + off[1] <= most, "{name}");
                assert!(off[0].max(off[1]) <= 2.0 * u, "{name}");
            }
        }
    }
}
