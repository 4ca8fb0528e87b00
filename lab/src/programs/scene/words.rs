//! A scene in words.

use std::fmt::Write as _;

use anyhow::{Context as _, Result};
use simulator::optics::Aperture;
use simulator::scene::{Effect, Scene, Sensor};

use crate::budget::{self, Errors};
use crate::programs::scene::Shown;
use crate::programs::scene::timing::Difference;
use crate::table;

/// All of it.
///
/// # Errors
/// None that are known.
pub fn of(shown: &Shown) -> Result<String> {
    let scene = &shown.scene;
    let mut text = String::new();
    writeln!(text, "{}: {}", shown.name, scene.about)?;
    writeln!(text, "{}", setting(scene))?;
    write_parameters(&mut text, scene)?;
    writeln!(text)?;
    write_budget(&mut text, shown)?;
    writeln!(text)?;
    writeln!(
        text,
        "{:.1} million pixels a second on one core; picture: {}",
        shown.timing.pixels_a_second * 1e-6,
        shown.picture.display()
    )?;
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
        Aperture::Lens { diameter } => format!("lens with a pupil of {:.2} mm", diameter * 1e3),
    };
    format!(
        "{sensor} ({:.2} um a pixel), {aperture}, target at {:.1} mm ({:.1} um a pixel), \
         exposure {:.3} ms",
        optics.pitch * 1e6,
        scene.distance * 1e3,
        optics.metres_per_pixel(optics.centre(scene.distance)) * 1e6,
        scene.exposure * 1e3
    )
}

/// The spot and the effects, each with its parameters as in the scene's file.
fn write_parameters(text: &mut String, scene: &Scene) -> Result<()> {
    let parameters = serde_json::to_value(scene).context("the scene's parameters")?;
    let effects = budget::effects(scene).map(Effect::name);
    for name in ["spot"].into_iter().chain(effects) {
        if let Some(parameters) = parameters.get(name) {
            writeln!(text, "  {name:17} {}", in_words(parameters))?;
        }
    }
    Ok(())
}

/// Of a table: name, errors in four columns, faults, share, times of a row and of the first.
type Line = [String; 9];

fn write_budget(text: &mut String, shown: &Shown) -> Result<()> {
    let (budget, timing) = (&shown.budget, &shown.timing);
    let plan = &budget.plan;
    let reading = match shown.scene.sensor.rows() {
        1 => "rows",
        _ => "frames",
    };
    writeln!(
        text,
        "{} {reading} ({} realisations, {} each over {:.3} s), centres by {}; times to simulate on one \
         core:",
        budget.whole.readings, plan.realisations, plan.readings, plan.seconds, budget.estimator
    )?;
    let mut lines: Vec<Line> = vec![
        [
            "",
            "RMS px",
            "mean px",
            "RMS um",
            "mean um",
            "faults",
            "share of error^2",
            "a row",
            "first row",
        ]
        .map(Into::into),
        line(
            "all effects",
            Some(&budget.whole),
            String::new(),
            [
                timing.nanoseconds_a_row,
                timing.nanoseconds_of_the_first_row,
            ]
            .map(duration),
        ),
    ];
    for (without, timing) in budget.without.iter().zip(&timing.effects) {
        let share = without.share.map_or("-".into(), |share| {
            let uncertainty = share.uncertainty.map(|it| format!(" ± {it:.3}"));
            format!("{:+.3}{}", share.value, uncertainty.unwrap_or_default())
        });
        let times = [timing.a_row, timing.first_row].map(|time| time.map_or("-".into(), longer));
        lines.push(line(
            &format!("without {}", without.effect.name()),
            without.errors.as_ref(),
            share,
            times,
        ));
    }
    *text += &table::text(&lines);
    for (name, count) in &budget.whole.faults {
        writeln!(
            text,
            "{count} of {} {reading}: {name}",
            budget.whole.readings
        )?;
    }
    Ok(())
}

fn line(
    name: &str,
    errors: Option<&Errors>,
    share: String,
    [a_row, first_row]: [String; 2],
) -> Line {
    let number = |value: fn(&Errors) -> Option<f64>, digits: usize| {
        (errors.and_then(value)).map_or("-".into(), |value| format!("{value:.digits$}"))
    };
    let faults = match errors {
        Some(errors) => (errors.faults.iter().map(|(_, count)| count))
            .sum::<u64>()
            .to_string(),
        None => "needed".into(),
    };
    [
        name.into(),
        number(|it| it.rms_px, 4),
        number(|it| it.mean_px, 4),
        number(|it| it.rms_um, 2),
        number(|it| it.mean_um, 2),
        faults,
        share,
        a_row,
        first_row,
    ]
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

/// A difference of times, unless it is lost in the scatter of the repetitions.
fn longer(time: Difference) -> String {
    if time.nanoseconds.abs() < 3.0 * time.uncertainty {
        return format!("0 ± {}", duration(time.uncertainty));
    }
    duration(time.nanoseconds)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_are_printed_with_their_parameters() {
        let scene = Scene::load("sunlit").expect("a scene");
        let mut text = String::new();
        write_parameters(&mut text, &scene).expect("text");
        println!("{text}");
        let names: Vec<&str> = (text.lines())
            .filter_map(|line| line.split_whitespace().next())
            .collect();
        assert_eq!(
            names,
            ["spot", "ambient", "shot_noise", "black_level", "read_noise"]
        );
        assert!(text.contains("read_noise        counts 4.0"));
    }

    #[test]
    fn durations_have_three_digits() {
        let all = [0.4, 12.34, 999.0, 1234.0, 45.6e3, -7.8e6].map(duration);
        assert_eq!(
            all,
            [
                "0.40 ns", "12.3 ns", "999 ns", "1.23 us", "45.6 us", "-7.80 ms"
            ]
        );
        let lost = Difference {
            nanoseconds: 29.0,
            uncertainty: 10.0,
        };
        assert_eq!(longer(lost), "0 ± 10.0 ns");
    }
}
