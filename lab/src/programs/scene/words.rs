//! A scene in words.

use simulator::optics::Aperture;
use simulator::scene::file::{PARAMETERS, in_words};
use simulator::scene::{Effect, Scene, Sensor};

use crate::budget::{Budget, Errors};
use crate::programs::scene::timing::{Difference, Timing};
use crate::table;

/// The scene, its table, and how often each fault came.
pub fn of(name: &str, scene: &Scene, budget: &Budget, timing: &Timing) -> String {
    let mut text = format!("{name}: {}\n{}\n\n", scene.about, setting(scene));
    let plan = &budget.plan;
    let reading = match scene.sensor.rows() {
        1 => "rows",
        _ => "frames",
    };
    text += &format!(
        "{} {reading} ({} realisations, {} each over {:.3} s); times to simulate on one core:\n",
        budget.whole.readings, plan.realisations, plan.readings, plan.seconds
    );
    let times = [timing.a_row, timing.first_row].map(duration);
    let mut lines: Vec<Line> = vec![
        HEAD.map(Into::into),
        line("all effects", Some(&budget.whole), String::new(), times),
    ];
    for (without, timing) in budget.without.iter().zip(&timing.effects) {
        let share = without.share.map_or("-".into(), |share| {
            let uncertainty = share.uncertainty.map(|it| format!(" ± {it:.3}"));
            format!("{:+.3}{}", share.value, uncertainty.unwrap_or_default())
        });
        let times = timing.map(|time| time.map_or("-".into(), longer));
        let name = format!("without {}", without.effect.name());
        lines.push(line(&name, without.errors.as_ref(), share, times));
    }
    text += &table::text(&lines);
    for (name, count) in &budget.whole.faults {
        text += &format!("{count} of {} {reading}: {name}\n", budget.whole.readings);
    }
    text
}

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

/// The parameters of every effect as a Markdown table, as the reader of scenes declares them.
pub fn effects() -> String {
    let mut text = "| effect | parameters: unit, range |\n|---|---|\n".to_owned();
    for effect in ["spot"].into_iter().chain(Effect::ALL.map(Effect::name)) {
        let of_effect = PARAMETERS.iter().filter(|it| it.effect == effect);
        let parameters = of_effect.map(|it| {
            let range = in_words(it.range);
            format!("`{}`: {}, {range}", it.name, it.unit)
        });
        let parameters = match effect {
            "diffraction" => "`\"fraunhofer\"` or `\"fresnel\"`".to_owned(),
            _ => parameters.collect::<Vec<_>>().join("; "),
        };
        text += &format!("| `{effect}` | {parameters} |\n");
    }
    text
}

/// Of a table: name, errors in four columns, faults, share, times of a row and of the first.
type Line = [String; 9];

const HEAD: [&str; 9] = [
    "",
    "RMS px",
    "mean px",
    "RMS um",
    "mean um",
    "faults",
    "share of error^2",
    "a row",
    "first row",
];

fn line(
    name: &str,
    errors: Option<&Errors>,
    share: String,
    [a_row, first_row]: [String; 2],
) -> Line {
    let number = |value: fn(&Errors) -> Option<f64>, digits: usize| {
        (errors.and_then(value)).map_or("-".into(), |value| format!("{value:.digits$}"))
    };
    let faults = errors.map_or("needed".into(), |errors| {
        let faults: u64 = errors.faults.iter().map(|(_, count)| count).sum();
        faults.to_string()
    });
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

/// How much longer a row takes with an effect. One that takes light away may save time.
fn longer(time: Difference) -> String {
    let least = 3.0 * time.uncertainty;
    match time.nanoseconds {
        it if it.abs() < least => format!("within noise ({})", duration(least)),
        it if it < 0.0 => format!("saves {}", duration(-it)),
        it => duration(it),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_have_three_digits() {
        let all = [0.4, 12.34, 999.0, 1234.0, 45.6e3, -7.8e6].map(duration);
        let all = all.join(", ");
        assert_eq!(all, "0.40 ns, 12.3 ns, 999 ns, 1.23 us, 45.6 us, -7.80 ms");
        let lost = Difference {
            nanoseconds: 29.0,
            uncertainty: 10.0,
        };
        let of = |nanoseconds| {
            longer(Difference {
                nanoseconds,
                ..lost
            })
        };
        let all = [-29.0, 29.0, 31.0, -7800.0].map(of).join(", ");
        assert_eq!(
            all,
            "within noise (30.0 ns), within noise (30.0 ns), 31.0 ns, saves 7.80 us"
        );
    }
}
