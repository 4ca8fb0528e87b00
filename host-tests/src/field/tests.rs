//! Against theory.

use std::time::Instant;

use super::*;
use crate::profiles::Slit;

const PIXEL: f64 = 5.86e-6;

/// Places of `count` pixels about the geometric centre, every `step`-th.
fn pixels(count: usize, step: usize) -> Vec<f64> {
    (0..count / step)
        .map(|i| ((i * step) as f64 - 0.5 * count as f64) * PIXEL)
        .collect()
}

fn average(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

#[test]
#[ignore = "shows the time that a view takes"]
fn time_of_a_view() {
    for (diameter, linewidth, polarisations) in [
        (0.5e-3, 0.0, 1),
        (0.5e-3, 0.5e-9, 2),
        (1e-3, 0.0, 1),
        (1e-3, 0.5e-9, 2),
    ] {
        let laser = Laser {
            linewidth,
            wavelengths: 5,
            ..Laser::focused(diameter, 0.8)
        };
        let scattering = Scattering {
            polarisations,
            path_spread: 0.2e-3,
            ..Scattering::surface()
        };
        let start = Instant::now();
        let surface = Surface::new(&laser, &scattering, 1).unwrap();
        let prepared = start.elapsed().as_secs_f64();
        let (columns, rows) = (pixels(160, 1), pixels(600, 4));
        let start = Instant::now();
        let mut sum = 0.0;
        for i in 0..100 {
            let view = View::at(0.8 + 25e-6 * f64::from(i));
            sum += slit_image(&surface, &view, &SlitAperture::nominal(), &columns, &rows)
                .unwrap()
                .light[80];
        }
        let slit = start.elapsed().as_secs_f64() / 100.0;
        println!(
            "{} mm, {} terms: surface {:.1} ms, slit {:.3} ms ({sum})",
            diameter * 1e3,
            surface.terms.len(),
            prepared * 1e3,
            slit * 1e3
        );
    }
}

/// A point of light makes the pattern of `profiles::Slit` along the row.
#[test]
fn a_tiny_spot_makes_the_pattern_of_a_point() {
    // A beam so small that it hits a single scatterer, and right on that.
    let laser = Laser::focused(1e-6, 0.8);
    let view = View {
        lateral: [1.8e-6, 45e-6],
        ..View::at(0.8)
    };
    let surface = Surface::new(&laser, &Scattering::surface(), 1).unwrap();
    let columns = pixels(160, 1);
    let image = slit_image(&surface, &view, &SlitAperture::nominal(), &columns, &[0.0]).unwrap();
    let exact = Slit::nominal(0.0);
    let unit = f64::from(image.light[80]) / exact.light(0.0);
    let worst = columns
        .iter()
        .zip(&image.light)
        .map(|(&x, &light)| (f64::from(light) / unit - exact.light(x)).abs())
        .fold(0.0, f64::max);
    println!("one scatterer against a point: within {worst:.1e} of the peak");
    assert!(worst < 1e-4 * exact.light(0.0));
}
