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
