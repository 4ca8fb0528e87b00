//! What auto exposure gives over a brightness of 10,000 to 1: `cargo exposure`.

mod figure;

use judges::changing_light::jumps::{Jumps, named};
use judges::changing_light::range::{self, Frames, Target, is_in_middle};

use crate::prelude::*;
use crate::{docs, progress, table};

/// Compares auto exposure with the best fixed exposure for targets from bright metal to black tape, and lets
/// the brightness jump at random. Takes about ten minutes on two cores.
#[derive(Args)]
pub struct Options {
    /// Targets, evenly in the logarithm of their reflectivity
    #[arg(long, default_value_t = 33, value_parser = clap::value_parser!(u16).range(2..=1000))]
    targets: u16,
    /// Frames for each target and exposure
    #[arg(long, default_value_t = 400, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
    /// Random jumps of the brightness
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    jumps: u64,
    /// Print one JSON object and nothing else
    #[arg(long)]
    json: bool,
    /// Also rewrite the tables and the figure of docs/exposure.md
    #[arg(long, conflicts_with = "json")]
    write: bool,
}

/// The targets of the range that have a name, and their reflectivities.
const NAMED: [(&str, f64); 3] = [
    ("black tape", 1e-4),
    ("white paper", 1.2e-3),
    ("bright metal", 1.0),
];

const PAGE: &str = "docs/exposure.md";
const FIGURE: &str = "docs/figures/exposure.svg";

pub fn main(options: &Options) -> Result<()> {
    let (count, frames) = (options.targets, options.frames as usize);
    let bar = progress::bar(count.into(), "targets {wide_bar} {pos}/{len}, {eta} left")?;
    let targets = range::targets(count.into(), frames, &|| bar.inc(1));
    bar.finish_and_clear();
    let bar = progress::bar(options.jumps, "jumps {wide_bar} {pos}/{len}, {eta} left")?;
    let jumps = Jumps::run(options.jumps, &|done| bar.inc(done));
    bar.finish_and_clear();
    if options.json {
        let all = serde_json::json!({"targets": targets, "jumps": jumps});
        println!("{}", serde_json::to_string_pretty(&all)?);
        return Ok(());
    }
    let blocks = [
        ("cargo exposure", range_in_words(&targets)),
        ("cargo exposure, jumps", jumps_in_words(&jumps)),
    ];
    docs::print_or_write("cargo exposure", options.write, PAGE, &blocks)?;
    if options.write {
        figure::draw(&targets, &docs::path(FIGURE))?;
    }
    Ok(())
}

fn range_in_words(targets: &[Target]) -> String {
    let rows = targets.iter().map(|target| {
        let auto = &target.auto;
        let beyond_2 = 100.0 * auto.beyond_2 as f64 / auto.readings() as f64;
        vec![
            format!("{:.2e}", target.reflectivity),
            auto.exposure_us.to_string(),
            format!("{:.2}", auto.rms_um),
            format!("{:.2}", auto.r_um),
            format!("{beyond_2:.1}"),
            auto.beyond_5.to_string(),
            auto.flagged.to_string(),
            auto.faults.to_string(),
            target.best.exposure_us.to_string(),
            format!("{:.2}", target.best.rms_um),
            format!("{:.2}", target.ratio()),
            format!("{:.2}", target.ratio_of_lowest()),
        ]
    });
    let head = "reflectivity | exposure, us | RMS error, um | mean r, um | beyond 2, % | beyond 5 | flagged \
                | faults | best fixed, us | its RMS error, um | ratio | ratio, low spot";
    format!("{}\n{}", summary(targets), table::of(head, rows))
}

fn summary(targets: &[Target]) -> String {
    let all: Vec<Frames> = (targets.iter())
        .flat_map(|target| [target.auto, target.auto_lowest])
        .collect();
    let sum = |of: fn(&Frames) -> usize| all.iter().map(of).sum::<usize>();
    let readings = sum(Frames::readings);
    let middle = || targets.iter().filter(|it| is_in_middle(it.reflectivity));
    let most = |of: fn(&Target) -> f64| middle().map(of).fold(0.0, f64::max);
    let dark = targets.iter().filter(|it| it.longest.is_some());
    let brightest_at_longest = dark.map(|it| it.reflectivity).fold(0.0, f64::max);
    format!(
        "{} targets, {} frames of 16 rows for each target and exposure. Auto exposure gave {readings} \
         readings without a flag, {} with a flag and {} faults. Of the readings without a flag, {:.1} % \
         are within twice what their rows claim, and {} are beyond five times. In the middle 1000:1 of the \
         range the RMS error is at most {:.2} times the error with the best fixed exposure, and {:.2} \
         times if the spot is at the lower end of the band. The fixed exposure of 5600 us gives no faults \
         up to a reflectivity of {brightest_at_longest:.1e}.\n",
        targets.len(),
        targets.first().map_or(0, |it| it.auto.frames),
        sum(|it| it.flagged),
        sum(|it| it.faults),
        100.0 * (1.0 - sum(|it| it.beyond_2) as f64 / readings as f64),
        sum(|it| it.beyond_5),
        most(Target::ratio),
        most(Target::ratio_of_lowest),
    )
}

fn jumps_in_words(jumps: &Jumps) -> String {
    let faults = |faults| match named(faults).as_slice() {
        [] => "none".to_owned(),
        some => (some.iter())
            .map(|(name, count)| format!("{count} `{name}`"))
            .collect::<Vec<_>>()
            .join(", "),
    };
    let rows = [
        ("complete frames", jumps.frames.to_string()),
        (
            "faults in the frame of the jump",
            faults(&jumps.first_faults),
        ),
        ("faults in later frames", faults(&jumps.later_faults)),
        ("readings with a flag", jumps.flagged.to_string()),
        (
            "readings without a flag, error beyond 5u",
            jumps.beyond_5u.to_string(),
        ),
        ("largest error over u", format!("{:.2}", jumps.worst.ratio)),
        (
            "readings without a flag, error beyond five times what the rows claim",
            jumps.beyond_5_claims.to_string(),
        ),
        (
            "largest error over what the rows claim",
            format!("{:.1}", jumps.worst_over_claim.ratio),
        ),
    ];
    let rows = rows.map(|(name, value)| vec![name.to_owned(), value]);
    table::of(&format!("random jumps | {}", jumps.jumps), rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made_up(reflectivity: f64, rms_um: f64) -> Target {
        let best = Frames {
            exposure_us: 187,
            frames: 100,
            faults: 0,
            flagged: 1,
            rms_um: 2.0,
            bias_um: 0.0,
            r_um: 2.0,
            beyond_2: 0,
            beyond_5: 0,
        };
        Target {
            reflectivity,
            auto: with(best, |it| (it.rms_um, it.beyond_2) = (rms_um, 9)),
            auto_lowest: best,
            best,
            longest: (reflectivity < 1e-3).then_some(best),
        }
    }

    /// Only the middle of the range counts for the ratio. `cargo test programs::exposure` keeps the figure
    /// for you to look at.
    #[test]
    fn the_summary_and_the_figure_show_the_targets() {
        let targets = [(1.0, 9.0), (0.1, 2.4), (5e-4, 2.2)].map(|(at, rms)| made_up(at, rms));
        let words = range_in_words(&targets);
        for part in [
            "594 readings without a flag, 6 with a flag and 0 faults",
            "95.5 % are within",
            "at most 1.20 times",
            "up to a reflectivity of 5.0e-4",
            "| 1.00e-1 | 187 | 2.40 | 2.00 | 9.1 | 0 | 1 | 0 | 187 | 2.00 | 1.20 | 1.00 |",
        ] {
            assert!(words.contains(part), "{part}: {words}");
        }
        let path = std::env::temp_dir().join("slitrange-made-up-exposure.svg");
        figure::draw(&targets, &path).expect("a figure");
        let svg = std::fs::read_to_string(path).expect("a figure");
        for (name, _) in NAMED {
            let lines = svg.lines().filter(|line| *line == name);
            assert_eq!(lines.count(), 1, "{name}");
        }
    }

    #[test]
    fn faults_after_jumps_have_names() {
        let mut jumps = with(Jumps::default(), |it| it.jumps = 7);
        jumps.first_faults[3] = 2;
        let words = jumps_in_words(&jumps);
        let first = "frame of the jump | 2 `saturated` |";
        assert!(words.contains(first), "{words}");
        assert!(words.contains("later frames | none |"), "{words}");
    }
}
