//! A scene in words.

use std::fmt::Write as _;

use anyhow::{Context as _, Result};
use host_tests::budget::Errors;
use host_tests::optics::Aperture;
use host_tests::scene::{Scene, Sensor};

use crate::Shown;

/// All of it.
pub fn of(shown: &Shown) -> Result<String> {
    let scene = &shown.scene;
    let mut text = String::new();
    writeln!(text, "{}: {}", shown.name, scene.about)?;
    writeln!(text, "{}", setting(scene))?;
    writeln!(text)?;
    write_budget(&mut text, shown)?;
    writeln!(text)?;
    writeln!(
        text,
        "{:.1} million pixels a second on one core: {} a row, and {} once where the target stands still",
        shown.timing.pixels_a_second * 1e-6,
        duration(shown.timing.nanoseconds_a_row),
        duration(shown.timing.nanoseconds_once)
    )?;
    writeln!(text, "{}", shown.picture.display())?;
    Ok(text)
}

/// Sensor, aperture, distance, exposure.
pub fn setting(scene: &Scene) -> String {
    let sensor = match scene.sensor {
        Sensor::Tcd1304dg => "TCD1304DG".to_owned(),
        Sensor::Camera => "camera, 1920 x 600 pixels".to_owned(),
        Sensor::Row(pixels) => format!("a row of {pixels} pixels"),
    };
    let optics = &scene.optics;
    let aperture = match optics.aperture {
        Aperture::Slit { width, height } => {
            format!("slit {:.0} um x {:.1} mm", width * 1e6, height * 1e3)
        }
        Aperture::Lens { diameter } => format!("lens f/{:.1}", optics.focal_length / diameter),
    };
    format!(
        "{sensor} ({:.2} um a pixel), {aperture}, target at {:.1} mm ({:.1} um a pixel), exposure {:.3} ms",
        optics.pitch * 1e6,
        scene.distance * 1e3,
        optics.metres_per_pixel(optics.centre(scene.distance)) * 1e6,
        scene.exposure * 1e3
    )
}

fn write_budget(text: &mut String, shown: &Shown) -> Result<()> {
    let budget = &shown.budget;
    let plan = &budget.plan;
    let reading = match shown.scene.sensor.rows() {
        1 => "rows",
        _ => "frames",
    };
    writeln!(
        text,
        "{} {reading} ({} realisations, {} each over {:.3} s), centres by {}:",
        budget.whole.readings, plan.realisations, plan.readings, plan.seconds, budget.estimator
    )?;
    let mut rows = vec![[
        "".into(),
        "RMS px".into(),
        "mean px".into(),
        "RMS um".into(),
        "mean um".into(),
        "faults".into(),
        "its share of error^2".into(),
        "its time a row".into(),
        "".into(),
    ]];
    rows.push(row(
        "all effects",
        Some(&budget.whole),
        String::new(),
        duration(shown.timing.nanoseconds_a_row),
        String::new(),
    ));
    let parameters = parameters(&shown.scene)?;
    for (without, timing) in budget.without.iter().zip(&shown.timing.effects) {
        let share = without.share.map_or("-".into(), |share| {
            let uncertainty = share.uncertainty.map(|it| format!(" ± {it:.3}"));
            format!("{:+.3}{}", share.value, uncertainty.unwrap_or_default())
        });
        let time = match timing.nanoseconds_a_row {
            // Lost in the scatter of the repetitions.
            Some(time) if time.abs() < 3.0 * timing.uncertainty => {
                format!("0 ± {}", duration(timing.uncertainty))
            }
            Some(time) => duration(time),
            None => "-".into(),
        };
        rows.push(row(
            &format!("without {}", without.effect.name()),
            without.errors.as_ref(),
            share,
            time,
            (parameters.get(without.effect.name())).map_or_else(String::new, in_words),
        ));
    }
    write_table(text, &rows)?;
    for (name, count) in &budget.whole.faults {
        writeln!(
            text,
            "{count} of {} {reading}: {name}",
            budget.whole.readings
        )?;
    }
    Ok(())
}

fn row(
    name: &str,
    errors: Option<&Errors>,
    share: String,
    time: String,
    parameters: String,
) -> [String; 9] {
    let number = |value: Option<f64>, digits: usize| {
        value.map_or("-".into(), |value| format!("{value:.digits$}"))
    };
    let of = |value: fn(&Errors) -> Option<f64>| errors.and_then(value);
    let faults = match errors {
        Some(errors) => (errors.faults.iter())
            .map(|(_, count)| count)
            .sum::<u64>()
            .to_string(),
        None => "needed".into(),
    };
    [
        name.into(),
        number(of(|it| it.rms_px), 4),
        number(of(|it| it.mean_px), 4),
        number(of(|it| it.rms_um), 2),
        number(of(|it| it.mean_um), 2),
        faults,
        share,
        time,
        parameters,
    ]
}

/// First and last column to the left, the others to the right.
fn write_table(text: &mut String, rows: &[[String; 9]]) -> std::fmt::Result {
    let width = |column: usize| (rows.iter().map(|row| row[column].chars().count())).max();
    for row in rows {
        let mut line = String::new();
        for (column, cell) in row.iter().enumerate() {
            let width = width(column).unwrap_or(0);
            match column {
                0 => write!(line, "{cell:width$}")?,
                8 => write!(line, "  {cell}")?,
                _ => write!(line, "  {cell:>width$}")?,
            }
        }
        writeln!(text, "{}", line.trim_end())?;
    }
    Ok(())
}

/// The effects' parameters, as in the scene's file.
fn parameters(scene: &Scene) -> Result<serde_json::Value> {
    serde_json::to_value(scene).context("the scene's parameters")
}

/// `name value, name value`.
fn in_words(parameters: &serde_json::Value) -> String {
    let word = |value: &serde_json::Value| match value {
        serde_json::Value::String(word) => word.clone(),
        other => other.to_string(),
    };
    match parameters {
        serde_json::Value::Object(values) => (values.iter())
            .map(|(name, value)| format!("{} {}", name.replace('_', " "), word(value)))
            .collect::<Vec<_>>()
            .join(", "),
        other => word(other),
    }
}

/// Three digits.
fn duration(nanoseconds: f64) -> String {
    let (value, unit) = match nanoseconds.abs() {
        size if size < 1e3 => (nanoseconds, "ns"),
        size if size < 1e6 => (nanoseconds * 1e-3, "us"),
        _ => (nanoseconds * 1e-6, "ms"),
    };
    let digits = match value.abs() {
        size if size < 10.0 => 2,
        size if size < 100.0 => 1,
        _ => 0,
    };
    format!("{value:.digits$} {unit}")
}
