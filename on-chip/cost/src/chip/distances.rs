//! From a centre to a distance, by every form of a calibration.

use cost_on_chip::calibrations::{self, CENTRES, Form};
use slitrange::{Calibration, Fault, Micrometres, Pixels};

use super::board::let_the_log_out;
use super::counter::{self, Cost};

/// Counts a distance by every form at [`CENTRES`] centres.
pub fn measure() {
    for form in Form::ALL {
        let calibration = defmt::unwrap!(form.calibration());
        let mut costs = [Cost::default(); CENTRES];
        for (i, cost) in costs.iter_mut().enumerate() {
            let input = (&calibration, calibrations::asked(i));
            let mut output = Err(Fault::SensorSilent);
            *cost = counter::count(calibration_distance_at, &input, &mut output);
            let (distance, slope) = defmt::unwrap!(output.ok());
            defmt::println!(
                "distance {} number {} distance {} slope {}",
                form.name(),
                i,
                distance.to_bits(),
                slope.to_bits()
            );
            let_the_log_out();
        }
        counter::print("form", form.name(), ("centres", CENTRES as f32), costs);
    }
}

/// A distance and the curve's slope.
type Output = Result<(Micrometres, f32), Fault>;

// Under a name that it keeps in the ELF file: `cargo cost` counts from here.
#[inline(never)]
#[unsafe(no_mangle)]
extern "C" fn calibration_distance_at(input: &(&Calibration, Pixels), output: &mut Output) {
    let (calibration, centre) = input;
    *output = calibration.distance_at(*centre);
}
