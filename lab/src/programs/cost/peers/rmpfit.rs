//! The crate `rmpfit`, a translation of C's MPFIT.

use rmpfit::{MPError, MPFitter, MPResult, MPSuccess};

use super::gaussian::{Parameters, WINDOW, light};

/// Fits with the crate's defaults: numeric derivatives, tolerances 1e-10.
pub fn fit(pixels: &[f64; WINDOW], start: Parameters) -> Option<Parameters> {
    let mut parameters = start.to_array();
    let status = Fitter { pixels }.mpfit(&mut parameters).ok()?;
    match status.success {
        MPSuccess::Chi | MPSuccess::Par | MPSuccess::Both | MPSuccess::Dir => {
            Some(Parameters::from_array(parameters))
        }
        _ => None,
    }
}

struct Fitter<'a> {
    pixels: &'a [f64; WINDOW],
}

impl MPFitter for Fitter<'_> {
    fn number_of_points(&self) -> usize {
        WINDOW
    }

    fn eval(&mut self, parameters: &[f64], deviates: &mut [f64]) -> MPResult<()> {
        let &[amplitude, centre, scale, level] = parameters else {
            return Err(MPError::Eval);
        };
        let light = light(centre, scale);
        for ((deviate, &count), light) in deviates.iter_mut().zip(self.pixels).zip(light) {
            *deviate = count - (amplitude * light + level);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::programs::cost::peers::gaussian::examples;

    #[test]
    fn finds_a_noiseless_gaussian() {
        let (truth, pixels) = examples::noiseless();
        let off = fit(&pixels, examples::start()).expect("a fit").centre - truth.centre;
        println!("{off:.1e} px off");
        assert!(off.abs() < 1e-6, "{off}");
    }

    #[test]
    fn agrees_with_levenberg_marquardt() {
        for (window, bound) in examples::noisy(100) {
            let pixels = window.pixels.map(f64::from);
            let other =
                crate::programs::cost::peers::levenberg_marquardt::fit_f64(&pixels, window.start)
                    .expect("a fit");
            let off = (fit(&pixels, window.start).expect("a fit").centre - other.centre) / bound;
            assert!(off.abs() < 1e-3, "{off} of the bound");
        }
    }
}
