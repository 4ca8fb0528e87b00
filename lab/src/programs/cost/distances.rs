//! What a distance costs, and how exact it is, by every form of a calibration over the paper's geometry.

use anyhow::Context as _;
use cost_on_chip::calibrations::Form;
use slitrange::distance::eq1::Eq1;
use slitrange::distance::knots::Knot;
use slitrange::{BlackLevel, Calibration, CalibrationErrors, Estimator, Pixels, sensor_heads};
use slitrange_device::record::date::Date;
use slitrange_device::record::{MAX_ENCODED, Record, encode};

use crate::programs::cost::chip::{self, Chip};
use crate::table;

pub fn markdown(chip: &Chip) -> anyhow::Result<String> {
    let row = |form: Form| {
        let calibration = form.calibration().context("no calibration")?;
        let counted = chip::of_name(&chip.forms, form.name())?;
        Ok(vec![
            name(form).to_owned(),
            form.knots().to_string(),
            format!("{:.4}", error_max_um(form, &calibration)?),
            counted.instructions.to_string(),
            counted.most.to_string(),
            ram_bytes(form).to_string(),
            record_bytes(calibration)?.to_string(),
        ])
    };
    let rows = Form::ALL.map(row).into_iter();
    let rows = rows.collect::<anyhow::Result<Vec<_>>>()?;
    let head = "form | knots | error um | instructions | most | RAM B | record B";
    Ok(table::of(head, rows))
}

const fn name(form: Form) -> &'static str {
    match form {
        Form::Eq1 => "eq. (1)",
        Form::Cubic => "PCHIP",
        Form::Corrected => "eq. (1) + PCHIP of residuals",
    }
}

/// The largest error over the range, at 100,000 centres.
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
    Ok(most)
}

/// Bytes of RAM that the form's numbers take. A cubic takes two control points besides its knot.
fn ram_bytes(form: Form) -> usize {
    let knots = form.knots() * size_of::<Knot>();
    match form {
        Form::Eq1 => size_of::<Eq1>(),
        Form::Cubic => 2 * knots,
        Form::Corrected => size_of::<Eq1>() + 2 * knots,
    }
}

/// Bytes of the record in flash, with the settings of a sensor that left the factory.
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
            let most = 0.5 / 65536.0 + 1e-9;
            assert!(difference <= most, "{difference} px at {distance} m");
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
        let is_all = (numbers..numbers + 40).contains(&whole);
        assert!(is_all, "{whole} for {numbers}");
    }
}
