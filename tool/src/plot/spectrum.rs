//! The spectrum: how much of the scatter lies at which frequency. Welch's method: the mean over stretches of
//! the readings that overlap by half, each under a Hann window.

use std::f64::consts::PI;

use realfft::RealFftPlanner;

/// The longest stretch. Lines at 0 Hz and at half of the rate are left out: they have one sign only.
const LONGEST: usize = 4096;

/// The one-sided amplitude spectral density: frequencies in hertz, and millimetres over the root of a hertz.
/// Empty with fewer than 8 values.
pub fn density(mm: &[f64], rate: f64) -> Vec<(f64, f64)> {
    // Eight stretches or more, if there are enough readings.
    let length = (mm.len() / 4).next_power_of_two().clamp(8, LONGEST);
    let hann = |at: usize| 0.5 - 0.5 * (2.0 * PI * at as f64 / length as f64).cos();
    let window: Vec<f64> = (0..length).map(hann).collect();
    let weight: f64 = window.iter().map(|weight| weight * weight).sum();
    let plan = RealFftPlanner::<f64>::new().plan_fft_forward(length);
    let mut powers = vec![0.0; length / 2 + 1];
    let mut stretches = 0;
    for start in (0..mm.len()).step_by(length / 2) {
        let Some(stretch) = mm.get(start..start + length) else {
            break;
        };
        let mean = statistics::mean(stretch);
        let mut input: Vec<f64> = (stretch.iter().zip(&window))
            .map(|(mm, weight)| (mm - mean) * weight)
            .collect();
        let mut lines = plan.make_output_vec();
        // The lengths are those of the plan.
        if plan.process(&mut input, &mut lines).is_err() {
            break;
        }
        for (power, line) in powers.iter_mut().zip(&lines) {
            *power += line.norm_sqr();
        }
        stretches += 1;
    }
    if stretches == 0 {
        return vec![];
    }
    let line = |(place, power): (usize, &f64)| {
        // Both signs of a frequency.
        let density = 2.0 * power / (f64::from(stretches) * rate * weight);
        (place as f64 * rate / length as f64, density.sqrt())
    };
    let lines = powers.iter().enumerate().take(length / 2);
    lines.skip(1).map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn white_noise_is_flat_at_sigma_times_the_root_of_two_over_the_rate() {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let noise = |_| -> f64 { StandardNormal.sample(&mut random) };
        let mm: Vec<f64> = (0..1 << 16).map(noise).map(|it| 0.01 * it).collect();
        let found = statistics::rms(density(&mm, 50.0).iter().map(|(_, density)| density));
        let expected = 0.01 * (2.0_f64 / 50.0).sqrt();
        println!("{found:.6} of {expected:.6}");
        // 65536 values give a variance to 0.6 %, a deviation to 0.3 %.
        assert!((found / expected - 1.0).abs() < 0.015);
    }

    #[test]
    fn a_vibration_has_its_power_at_its_frequency() {
        // 0.02 mm at 7 Hz, 100 readings a second.
        let phase = |at: i32| 2.0 * PI * 7.0 * f64::from(at) / 100.0;
        let mm: Vec<f64> = (0..20_000)
            .map(|at| 800.0 + 0.02 * phase(at).sin())
            .collect();
        let lines = density(&mm, 100.0);
        let highest = lines.iter().max_by(|a, b| a.1.total_cmp(&b.1));
        let highest = highest.expect("lines");
        let step = lines[1].0 - lines[0].0;
        println!("{highest:?}, step {step}");
        assert!((highest.0 - 7.0).abs() <= step);
        // The power is half of the amplitude's square.
        let powers = lines.iter().map(|(_, density)| density * density * step);
        let power: f64 = powers.sum();
        assert!((power / (0.5 * 0.02 * 0.02) - 1.0).abs() < 1e-3, "{power}");
    }

    #[test]
    fn few_values_have_no_spectrum() {
        assert_eq!(density(&[1.0; 7], 1.0), []);
        assert_eq!(density(&[1.0; 16], 1.0).len(), 3);
    }
}
