//! What a distance costs, and how exact it is, by every form of a calibration over the paper's geometry.

use anyhow::Context as _;
use cost_on_chip::calibrations::Form;
use serde::Serialize;
use slitrange::base::units::Pixels;
use slitrange::centre::Estimator;
use slitrange::distance::Calibration;
use slitrange::distance::eq1::Eq1;
use slitrange::distance::knots::Knot;
use slitrange::light::black_level::BlackLevel;
use slitrange::reading::uncertainty::CalibrationErrors;
use slitrange::row::sensor_heads;
use slitrange_device::record::date::Date;
use slitrange_device::record::{MAX_ENCODED, Record, encode};

use crate::programs::cost::chip::Chip;

/// A form of a calibration.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Distance {
    /// What it is.
    pub form: &'static str,
    /// How many knots it has.
    pub knots: usize,
    /// The largest error over the range, in micrometres.
    pub error_max_um: f64,
    /// Instructions, the median over many centres.
    pub instructions: u64,
    /// The most of them.
    pub instructions_most: u64,
    /// Bytes of RAM that its numbers take.
    pub ram_bytes: usize,
    /// Bytes of its record in flash.
    pub record_bytes: usize,
}

/// Every form, with what was counted on the chip.
///
/// # Errors
/// A form is no calibration, or was not counted.
pub fn measure(chip: &Chip) -> anyhow::Result<Vec<Distance>> {
    Form::ALL
        .into_iter()
        .map(|form| {
            let calibration = form.calibration().context("no calibration")?;
            let counted = chip
                .forms
                .iter()
                .find(|counted| counted.name == form.name());
            let counted = counted.context("the chip's program did not count it")?;
            Ok(Distance {
                form: name(form),
                knots: form.knots(),
                error_max_um: error_max_um(form, &calibration)?,
                instructions: counted.instructions,
                instructions_most: counted.instructions_most,
                ram_bytes: ram_bytes(form),
                record_bytes: record_bytes(calibration)?,
            })
        })
        .map(|distance: anyhow::Result<Distance>| distance.context("a form of a calibration"))
        .collect()
}

/// Its name for a reader.
const fn name(form: Form) -> &'static str {
    match form {
        Form::Eq1 => "eq. (1)",
        Form::Cubic => "PCHIP",
        Form::Corrected => "eq. (1) + PCHIP of residuals",
    }
}

/// At 100,000 centres.
fn error_max_um(form: Form, calibration: &Calibration) -> anyhow::Result<f64> {
    let (first, last) = calibration.valid();
    let step = (last.to_bits() - first.to_bits()) as usize / 100_000;
    let mut most = 0.0f64;
    for bits in (first.to_bits()..=last.to_bits()).step_by(step) {
        let centre = Pixels::from_bits(bits);
        let (distance, _) = calibration
            .distance_at(centre)
            .map_err(|fault| anyhow::anyhow!("{fault} at {centre} px"))?;
        most = most.max((distance.to_f64() - form.truth(centre.to_f64())).abs());
    }
    // To a tenth of a nanometre.
    Ok((most * 1e4).round() / 1e4)
}

/// A cubic takes two control points besides its knot.
fn ram_bytes(form: Form) -> usize {
    let knots = form.knots() * size_of::<Knot>();
    match form {
        Form::Eq1 => size_of::<Eq1>(),
        Form::Cubic => 2 * knots,
        Form::Corrected => size_of::<Eq1>() + 2 * knots,
    }
}

/// With the settings of a sensor that left the factory.
fn record_bytes(calibration: Calibration) -> anyhow::Result<usize> {
    let record = Record {
        serial_number: 1,
        date: Date::new(2026, 1, 1).context("a day")?,
        geometry: sensor_heads::tcd1304dg(),
        estimator: Estimator::default(),
        black_level: BlackLevel::Shielded,
        calibration,
        profile: None,
        comb: None,
        front_end: None,
        errors: CalibrationErrors::Unknown,
    };
    Ok(encode(&record, &mut [0; MAX_ENCODED])?.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::apparatus::{Aperture, TABLE, optics};
    use slitrange::distance::knots::MAX_KNOTS;

    /// The program on the chip states the numbers of the paper's geometry again.
    #[test]
    fn the_geometry_is_the_papers() {
        let optics = optics(Aperture::Slit);
        let (first, last) = Form::Eq1.calibration().expect("a curve").valid();
        for (centre, distance) in [(first, TABLE.1), (last, TABLE.0)] {
            let difference = (centre.to_f64() - optics.centre(distance)).abs();
            assert!(
                difference <= 0.5 / 65536.0 + 1e-9,
                "{difference} px at {distance} m"
            );
        }
        for i in 0..=1000 {
            let centre = first.to_f64() + (last.to_f64() - first.to_f64()) * f64::from(i) / 1000.0;
            let difference = Form::Eq1.truth(centre) - 1e6 * optics.distance(centre);
            assert!(difference.abs() <= 1e-6, "{difference} um at {centre}");
        }
    }

    #[test]
    fn a_calibration_takes_the_memory_of_the_most_knots() {
        // Room for the most knots, each with two control points; their number and their range.
        let numbers = MAX_KNOTS * 2 * size_of::<Knot>();
        let whole = size_of::<Calibration>() - size_of::<Eq1>();
        assert!(
            (numbers..numbers + 40).contains(&whole),
            "{whole} for {numbers}"
        );
    }
}
