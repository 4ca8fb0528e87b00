//! Where the target is to be, and who brings it there.

use std::io::{BufRead, Write};
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use calibration::positions::{STAGE_MM, check, even_distances, even_pixels};
use statistics::least_and_most;

use super::taken::Millimetres;

/// No distance given in metres by a slip is larger: the largest that a record holds, in metres.
const METRES: f64 = 8.38;
/// The step of the distances that a person is asked for, in millimetres: what a ruler shows.
const RULER_MM: f64 = 1.0;

/// How positions lie between the first and the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Spacing {
    /// Centres, in pixels: closer together where the target is near. Best for a fit, because every part of
    /// the sensor counts alike. That is even in 1/(d - D), here with D = -115.4 mm of the nominal sensor: it
    /// assumes distances from the laser's origin.
    Pixels,
    /// Distances, in millimetres: for a stage whose zero is elsewhere, or that counts the other way.
    Distance,
}

/// Where the target is to be.
#[derive(Clone, Debug, clap::Args)]
pub struct Which {
    /// The distances to go to: a file with one in millimetres a line, # before remarks
    #[arg(long, value_name = "LIST", conflicts_with_all = ["from", "to", "points", "spacing", "round"])]
    positions: Option<PathBuf>,
    /// The first distance in millimetres
    #[arg(
        long,
        value_name = "MM",
        required_unless_present = "positions",
        allow_negative_numbers = true
    )]
    from: Option<f64>,
    /// The last distance in millimetres
    #[arg(
        long,
        value_name = "MM",
        required_unless_present = "positions",
        allow_negative_numbers = true
    )]
    to: Option<f64>,
    /// How many positions there are from the first to the last, both included
    #[arg(long, value_name = "N", default_value_t = 30)]
    points: usize,
    /// What is even between them: `pixels` assumes distances from the laser's origin; if the stage's zero is
    /// elsewhere, take `distance`
    #[arg(long, value_enum, default_value_t = Spacing::Pixels)]
    spacing: Spacing,
    /// Round the positions between the first and the last to multiples of this, so that a person can set
    /// them [default: 1, and 0.001 with a stage]
    #[arg(long, value_name = "MM", value_parser = step)]
    round: Option<f64>,
}

impl Which {
    /// The distances in millimetres, each beyond the one before: all rise, or all fall. `by_hand`: a person
    /// moves the target, with a ruler.
    ///
    /// # Errors
    /// The file cannot be read, or what it says is no list of distances; likewise the ends. Or the distances
    /// look like metres.
    pub fn list(&self, by_hand: bool) -> Result<Vec<f64>> {
        let usual = if by_hand { RULER_MM } else { STAGE_MM };
        let positions = self.positions(self.round.unwrap_or(usual))?;
        let from_laser = self.positions.is_none() && self.spacing == Spacing::Pixels;
        // A stage may have its zero in the middle of a few millimetres.
        ensure!(
            !(by_hand || from_laser) || positions.iter().any(|mm| mm.abs() > METRES),
            "the positions are all within {METRES} mm of zero: distances are in millimetres (590, not 0.59)"
        );
        Ok(positions)
    }

    fn positions(&self, round: f64) -> Result<Vec<f64>> {
        match (&self.positions, self.from, self.to) {
            (Some(path), ..) => {
                let shown = format!("the positions in {}", path.display());
                let text = std::fs::read_to_string(path);
                listed(&text.with_context(|| format!("{shown} cannot be read"))?).context(shown)
            }
            (None, Some(from), Some(to)) => match self.spacing {
                Spacing::Pixels => even_pixels(from, to, self.points, round),
                Spacing::Distance => even_distances(from, to, self.points, round),
            },
            (None, ..) => bail!("say where the target is to be: --positions, or --from and --to"),
        }
    }
}

/// Positions from a file's text, put in order: from the end that it begins with.
fn listed(text: &str) -> Result<Vec<f64>> {
    let mut positions: Vec<f64> = Vec::new();
    for (line, number) in text.lines().zip(1..) {
        let word = line.split('#').next().unwrap_or_default().trim();
        if word.is_empty() {
            continue;
        }
        let position = distance(word).with_context(|| format!("line {number}"))?;
        ensure!(
            !positions.contains(&position),
            "line {number}: {word} is there already; a position is measured once, with more --frames if need \
             be"
        );
        positions.push(position);
    }
    let (Some(first), Some(last)) = (positions.first(), positions.last()) else {
        bail!("there are none: write one distance in millimetres a line");
    };
    let falls = first > last;
    positions.sort_by(f64::total_cmp);
    if falls {
        positions.reverse();
    }
    Ok(positions)
}

/// A step in millimetres, as a person types it.
fn step(text: &str) -> Result<f64, String> {
    let mm = text.parse().ok();
    let mm = mm.filter(|mm| (STAGE_MM..=100.0).contains(mm));
    mm.ok_or_else(|| format!("it must be {STAGE_MM} to 100 mm"))
}

/// A distance in millimetres that a person wrote.
fn distance(word: &str) -> Result<f64> {
    let Ok(mm) = word.parse::<f64>() else {
        bail!("`{word}` is no distance in millimetres: write digits, with a point before decimals");
    };
    check(mm, word)?;
    // No -0.
    Ok(mm + 0.0)
}

/// Who moves the target.
pub enum Mover<'a> {
    /// A person, asked line by line.
    Person {
        /// What the person types.
        input: &'a mut dyn BufRead,
        /// Distances that need not be typed twice, in millimetres.
        expected: RangeInclusive<f64>,
    },
    /// A program: its command line, with `{}` for the distance in millimetres.
    Stage(&'a str),
}

/// What came of moving the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Moved {
    /// It is at that distance, in millimetres.
    To(f64),
    /// It is where it was, and the point that was refused for that counts.
    Stayed,
    /// This position is left out.
    Skip,
    /// The last point is to be taken again.
    Back,
    /// That is all for now.
    Quit,
    /// The input ended.
    End,
}

impl<'a> Mover<'a> {
    /// A person, who goes through these positions in millimetres.
    pub fn person(input: &'a mut dyn BufRead, wanted: &[f64]) -> Self {
        let (least, most) = least_and_most(wanted);
        let beyond = BEYOND_MM.max(0.1 * (most - least));
        Self::Person {
            input,
            expected: least - beyond..=most + beyond,
        }
    }

    /// Brings the target to a distance in millimetres.
    pub fn to(&mut self, mm: f64, output: &mut dyn Write) -> Result<Moved> {
        match self {
            Self::Person { input, expected } => ask(mm, *input, expected, output),
            Self::Stage(command) => {
                move_stage(command, mm)?;
                Ok(Moved::To(mm))
            }
        }
    }

    /// After the last position: a person may take the last point back.
    pub fn finish(&mut self, output: &mut dyn Write) -> Result<Moved> {
        let Self::Person { input, .. } = self else {
            return Ok(Moved::Quit);
        };
        write!(
            output,
            "that was the last position: Enter ends, u takes the last point back: "
        )?;
        let is_back = read(*input, output)?.as_deref() == Some("u");
        Ok(if is_back { Moved::Back } else { Moved::Quit })
    }
}

/// A line that a person types, without the blanks around it. None at the input's end (Ctrl-D).
pub(super) fn read(input: &mut dyn BufRead, output: &mut dyn Write) -> Result<Option<String>> {
    output.flush()?;
    let mut typed = String::new();
    if input.read_line(&mut typed)? == 0 {
        writeln!(output)?;
        return Ok(None);
    }
    Ok(Some(typed.trim().to_owned()))
}

fn ask(
    mm: f64,
    input: &mut dyn BufRead,
    expected: &RangeInclusive<f64>,
    output: &mut dyn Write,
) -> Result<Moved> {
    let mut doubtful = None;
    loop {
        write!(
            output,
            "move the target to {mm} mm, then Enter; or type where it is (s skips, u takes the last point \
             back, q stops): "
        )?;
        let Some(typed) = read(input, output)? else {
            return Ok(Moved::End);
        };
        match typed.as_str() {
            "" => return Ok(Moved::To(mm)),
            "s" => return Ok(Moved::Skip),
            "t" => return Ok(Moved::Stayed),
            "u" => return Ok(Moved::Back),
            "q" => return Ok(Moved::Quit),
            word => match distance(word.trim_end_matches("mm").trim_end()) {
                Ok(mm) if expected.contains(&mm) || doubtful == Some(mm) => {
                    return Ok(Moved::To(mm));
                }
                Ok(mm) => {
                    doubtful = Some(mm);
                    writeln!(
                        output,
                        "{mm} mm is far from the positions of this run: distances are in millimetres; type \
                         it again if it is right"
                    )?;
                }
                Err(error) => writeln!(output, "{error:#}")?,
            },
        }
    }
}

fn move_stage(command: &str, mm: f64) -> Result<()> {
    let line = command.replace("{}", &Millimetres(mm).to_string());
    let (shell, option) = match cfg!(windows) {
        true => ("cmd", "/C"),
        false => ("sh", "-c"),
    };
    let status = Command::new(shell).args([option, &line]).status();
    let status =
        status.with_context(|| format!("the stage's command `{line}` cannot be started"))?;
    let failed = || format!("the stage's command `{line}` failed: {status}");
    ensure!(status.success(), failed());
    Ok(())
}

/// Whether a stage's command says where the distance goes.
pub fn check_command(command: &str) -> Result<()> {
    ensure!(
        command.contains("{}"),
        "the stage's command `{command}` has no {{}} where the distance goes: --stage-command 'move-stage \
         {{}}'"
    );
    Ok(())
}

/// So far beyond the positions of a run a person may type a distance, or a tenth of the run's length.
const BEYOND_MM: f64 = 50.0;
/// By how much a person misses a position who then types where the target is, in millimetres.
const MISSED_MM: f64 = 5.0;

/// The positions, of those wanted, at which there is no point yet. A point stands for a position if it lies
/// less than half of the way to that one's neighbour from it, and no further than a person may have missed
/// it.
pub fn missing(wanted: &[f64], taken: &[f64]) -> Vec<f64> {
    let is_missing = |index: usize| {
        let position = wanted[index];
        let neighbours = [index.checked_sub(1), index.checked_add(1)].into_iter();
        let neighbours = neighbours.filter_map(|index| wanted.get(index?));
        let half_ways = neighbours.map(|neighbour| (neighbour - position).abs() / 2.0);
        let half_way = half_ways.fold(MISSED_MM, f64::min);
        !taken.iter().any(|mm| (mm - position).abs() < half_way)
    };
    let missing = (0..wanted.len()).filter(|&index| is_missing(index));
    missing.map(|index| wanted[index]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Positions at even steps of the centre.
    fn between(from: f64, to: f64, points: usize) -> Which {
        Which {
            positions: None,
            from: Some(from),
            to: Some(to),
            points,
            spacing: Spacing::Pixels,
            round: None,
        }
    }

    /// A person reads whole millimetres off a ruler. The ends are as they were typed.
    #[test]
    fn positions_are_rounded_for_a_person() {
        let which = |from, to, points, round| Which {
            round,
            ..between(from, to, points)
        };
        let list = |round, by_hand| which(590.5, 1030.0, 5, round).list(by_hand);
        let by_hand = list(None, true).expect("positions");
        assert_eq!(by_hand, [590.5, 665.0, 758.0, 876.0, 1030.0]);
        let coarse = list(Some(5.0), true).expect("positions");
        assert_eq!(coarse, [590.5, 665.0, 760.0, 875.0, 1030.0]);
        let stage = list(None, false).expect("positions");
        let off = by_hand.iter().zip(&stage).map(|(a, b)| (a - b).abs());
        assert!(off.fold(0.0, f64::max) <= 0.5 && stage != by_hand);
        let close = which(600.0, 610.0, 12, None);
        let error = close.list(true).expect_err("too close");
        let advice = "take fewer --points, or a finer --round";
        assert!(error.to_string().ends_with(advice));
    }

    #[test]
    fn metres_are_refused() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("list");
        std::fs::write(&path, "0.59\n0.7\n1.03\n").expect("written");
        let which = |positions, spacing| Which {
            positions,
            spacing,
            ..between(0.59, 1.03, 3)
        };
        for (refused, by_hand) in [
            (which(None, Spacing::Pixels), false),
            (which(Some(path.clone()), Spacing::Pixels), true),
        ] {
            let error = refused.list(by_hand).expect_err("metres").to_string();
            assert!(error.ends_with("in millimetres (590, not 0.59)"), "{error}");
        }
        // A stage with its zero in the middle of its travel.
        for taken in [
            which(None, Spacing::Distance),
            which(Some(path), Spacing::Pixels),
        ] {
            taken.list(false).expect("positions");
        }
    }

    #[test]
    fn malformed_lists_are_refused() {
        let word =
            "line 2: `610,5` is no distance in millimetres: write digits, with a point before \
                    decimals"
                .to_owned();
        let none = "there are none: write one distance in millimetres a line".to_owned();
        let far = |at| format!("line {at} is no distance of a target: it is -8380 to 8380 mm");
        for (text, says) in [
            ("600\n610,5\n", word),
            ("600\nnan\n", far("2: nan")),
            ("600\n# far\n8381\n", far("3: 8381")),
            ("\n# none\n", none),
        ] {
            assert_eq!(format!("{:#}", listed(text).expect_err("refused")), says);
        }
        let twice = listed("600\n610\n600.0 # again\n").expect_err("refused");
        assert!((twice.to_string()).starts_with("line 3: 600.0 is there already"));
    }

    #[test]
    fn a_list_is_walked_in_order_from_the_end_it_begins_with() {
        let list = |text| listed(text).expect("positions");
        let rising = list("600\n 700.5 # here\n650\n900\n");
        assert_eq!(rising, [600.0, 650.0, 700.5, 900.0]);
        assert_eq!(list("900\n600\n650\n"), [900.0, 650.0, 600.0]);
        // The zero of a stage may be anywhere.
        assert_eq!(list("-210\n-0\n210\n"), [-210.0, 0.0, 210.0]);
    }

    #[test]
    fn positions_without_a_near_point_are_missing() {
        let wanted = [600.0, 610.0, 640.0, 700.0];
        assert_eq!(missing(&wanted, &[]), wanted);
        // Typed beside the position; beyond half-way to the next; too far off; exactly there.
        assert_eq!(missing(&wanted, &[604.9, 646.0, 700.0]), [610.0, 640.0]);
        assert_eq!(missing(&wanted, &[605.1, 644.9, 700.0]), [600.0]);
        assert_eq!(missing(&wanted, &wanted), [0.0; 0]);
        assert_eq!(missing(&[600.0], &[610.0]), [600.0]);
    }

    #[test]
    fn answers_of_a_person_move_skip_or_quit() {
        let mut output = Vec::new();
        let mut answers = b"\n 612.5 mm\nsixhundred\ns\nt\nu\n61\n61\nq\n".as_slice();
        let mut mover = Mover::person(&mut answers, &[600.0, 700.0]);
        let mut next = || mover.to(610.0, &mut output).expect("an answer");
        for expected in [
            Moved::To(610.0),
            Moved::To(612.5),
            Moved::Skip,
            Moved::Stayed,
            Moved::Back,
            // Centimetres, by a slip: only typed twice.
            Moved::To(61.0),
            Moved::Quit,
            Moved::End,
        ] {
            assert_eq!(next(), expected);
        }
        let output = String::from_utf8(output).expect("text");
        println!("{output}");
        assert!(output.starts_with("move the target to 610 mm, then Enter;"));
        assert_eq!(output.matches("61 mm is far from the positions").count(), 1);
        assert!(output.contains("`sixhundred` is no distance in millimetres: "));
    }

    #[test]
    fn the_command_of_a_stage_must_say_where_the_distance_goes() {
        assert!(check_command("stage --to").is_err());
    }
}
