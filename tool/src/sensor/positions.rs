//! Where the target is to be, and who brings it there.

use std::io::{BufRead, Write};
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

use super::taken::Millimetres;

/// What is as far from eq. (1)'s pole in pixels as the next, as near as can be said before it is known: that
/// of the nominal geometry, D of [`slitrange::distance::eq1::NOMINAL`] in millimetres.
const D_MM: f64 = -115.4;

/// The least and the largest distance that a record can hold, in millimetres, with a little to spare. The
/// stage's zero may be anywhere: where it is, eq. (1)'s D takes in.
const SENSIBLE_MM: std::ops::RangeInclusive<f64> = -8380.0..=8380.0;

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
    #[arg(long, value_name = "LIST", conflicts_with_all = ["from", "to", "points", "spacing"])]
    pub positions: Option<PathBuf>,
    /// The first distance in millimetres
    #[arg(
        long,
        value_name = "MM",
        required_unless_present = "positions",
        allow_negative_numbers = true
    )]
    pub from: Option<f64>,
    /// The last distance in millimetres
    #[arg(
        long,
        value_name = "MM",
        required_unless_present = "positions",
        allow_negative_numbers = true
    )]
    pub to: Option<f64>,
    /// How many positions there are from the first to the last, both included
    #[arg(long, value_name = "N", default_value_t = 30)]
    pub points: usize,
    /// What is even between them: `pixels` assumes distances from the laser's origin; if the stage's zero is
    /// elsewhere, take `distance`
    #[arg(long, value_enum, default_value_t = Spacing::Pixels)]
    pub spacing: Spacing,
}

impl Which {
    /// The distances in millimetres, each beyond the one before: all rise, or all fall.
    ///
    /// # Errors
    /// The file cannot be read, or what it says is no list of distances; likewise the ends.
    pub fn list(&self) -> Result<Vec<f64>> {
        match (&self.positions, self.from, self.to) {
            (Some(path), ..) => {
                let text = std::fs::read_to_string(path).with_context(|| {
                    format!("the positions in {} cannot be read", path.display())
                })?;
                listed(&text).with_context(|| format!("the positions in {}", path.display()))
            }
            (None, Some(from), Some(to)) => spread(from, to, self.points, self.spacing),
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

/// Positions from one end to the other, to a micrometre.
fn spread(from: f64, to: f64, points: usize, spacing: Spacing) -> Result<Vec<f64>> {
    for end in [from, to] {
        ensure!(
            SENSIBLE_MM.contains(&end),
            "{end} mm is no distance of a target: {}",
            sensible()
        );
        ensure!(
            spacing == Spacing::Distance || end > D_MM,
            "{end} mm is no distance from the laser's origin, which even pixels are reckoned from: give \
             --spacing distance"
        );
    }
    let most = ((to - from).abs() * 1000.0) as usize;
    ensure!(
        (2..=most).contains(&points),
        "{points} positions from {from} to {to} mm: there must be at least 2, and a micrometre or more apart"
    );
    let last = (points - 1) as f64;
    Ok((0..points)
        .map(|index| {
            let part = index as f64 / last;
            let mm = match spacing {
                Spacing::Distance => from + (to - from) * part,
                Spacing::Pixels => {
                    let (first, last) = (1.0 / (from - D_MM), 1.0 / (to - D_MM));
                    D_MM + 1.0 / (first + (last - first) * part)
                }
            };
            (mm * 1000.0).round() / 1000.0
        })
        // No -0.
        .map(|mm| mm + 0.0)
        .collect())
}

/// A distance in millimetres that a person wrote.
fn distance(word: &str) -> Result<f64> {
    let Ok(mm) = word.parse::<f64>() else {
        bail!("`{word}` is no distance in millimetres");
    };
    ensure!(
        SENSIBLE_MM.contains(&mm),
        "{word} is no distance of a target: {}",
        sensible()
    );
    // No -0.
    Ok(mm + 0.0)
}

fn sensible() -> String {
    format!("it is {} to {} mm", SENSIBLE_MM.start(), SENSIBLE_MM.end())
}

/// Who moves the target.
pub enum Mover<'a> {
    /// A person, asked line by line.
    Person {
        /// What the person types.
        input: &'a mut dyn BufRead,
    },
    /// A program: its command line, with `{}` for the distance in millimetres.
    Stage(&'a str),
}

/// What came of moving the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Moved {
    /// It is at that distance, in millimetres.
    To(f64),
    /// This position is left out.
    Skip,
    /// That is all for now.
    Quit,
}

impl Mover<'_> {
    /// Brings the target to a distance in millimetres.
    ///
    /// # Errors
    /// The stage's command failed.
    pub fn to(&mut self, mm: f64, output: &mut dyn Write) -> Result<Moved> {
        match self {
            Self::Person { input } => ask(mm, *input, output),
            Self::Stage(command) => {
                move_stage(command, mm)?;
                Ok(Moved::To(mm))
            }
        }
    }
}

fn ask(mm: f64, input: &mut dyn BufRead, output: &mut dyn Write) -> Result<Moved> {
    loop {
        write!(
            output,
            "move the target to {} mm, then Enter; or type where it is (s skips, q stops): ",
            Millimetres(mm)
        )?;
        output.flush()?;
        let mut typed = String::new();
        // The end of the input, Ctrl-D, is the end of the run.
        if input.read_line(&mut typed)? == 0 {
            writeln!(output)?;
            return Ok(Moved::Quit);
        }
        match typed.trim() {
            "" => return Ok(Moved::To(mm)),
            "s" => return Ok(Moved::Skip),
            "q" => return Ok(Moved::Quit),
            word => match distance(word.trim_end_matches("mm").trim_end()) {
                Ok(mm) => return Ok(Moved::To(mm)),
                Err(error) => writeln!(output, "{error:#}")?,
            },
        }
    }
}

fn move_stage(command: &str, mm: f64) -> Result<()> {
    let line = command.replace("{}", &Millimetres(mm).to_string());
    let status = shell(&line)
        .status()
        .with_context(|| format!("the stage's command `{line}` cannot be started"))?;
    ensure!(
        status.success(),
        "the stage's command `{line}` failed: {status}"
    );
    Ok(())
}

#[cfg(unix)]
fn shell(line: &str) -> Command {
    let mut shell = Command::new("sh");
    shell.arg("-c").arg(line);
    shell
}

#[cfg(windows)]
fn shell(line: &str) -> Command {
    let mut shell = Command::new("cmd");
    shell.arg("/C").arg(line);
    shell
}

/// Whether a stage's command says where the distance goes.
///
/// # Errors
/// It does not.
pub fn check_command(command: &str) -> Result<()> {
    ensure!(
        command.contains("{}"),
        "the stage's command `{command}` has no {{}} where the distance goes: --stage-command 'move-stage \
         {{}}'"
    );
    Ok(())
}

/// By how much a person misses a position who then types where the target is, in millimetres.
const MISSED_MM: f64 = 5.0;

/// The positions, of those wanted, at which there is no point yet. A point stands for a position if it lies
/// less than half of the way to that one's neighbour from it, and no further than a person may have missed
/// it.
pub fn missing(wanted: &[f64], taken: &[f64]) -> Vec<f64> {
    wanted
        .iter()
        .enumerate()
        .filter(|&(index, &position)| {
            let neighbours = [index.checked_sub(1), index.checked_add(1)];
            let half_way = neighbours
                .into_iter()
                .filter_map(|index| wanted.get(index?))
                .map(|neighbour| (neighbour - position).abs() / 2.0)
                .fold(MISSED_MM, f64::min);
            !taken.iter().any(|mm| (mm - position).abs() < half_way)
        })
        .map(|(_, &position)| position)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_even_on_the_sensor() {
        let even = spread(600.0, 1020.0, 8, Spacing::Pixels).expect("positions");
        println!("{even:?}");
        assert_eq!((even[0], even[7]), (600.0, 1020.0));
        let nominal = slitrange::distance::eq1::NOMINAL.expect("a curve");
        let (d, k) = (
            nominal.d().to_f64() / 1e3,
            nominal.k() as f64 / 65536.0 / 1e3,
        );
        let pixels: Vec<f64> = even.iter().map(|mm| k / (mm - d)).collect();
        let steps: Vec<f64> = pixels.windows(2).map(|pair| pair[0] - pair[1]).collect();
        println!("{steps:?}");
        // 1519 px over seven steps; rounding to a micrometre is up to 0.006 px, twice.
        assert!(
            steps.iter().all(|step| (step - steps[0]).abs() < 0.05),
            "{steps:?}"
        );
        let falling = spread(1020.0, 600.0, 8, Spacing::Pixels).expect("positions");
        assert!(even.iter().eq(falling.iter().rev()));
        assert_eq!(
            spread(600.0, 1020.0, 3, Spacing::Distance).expect("positions"),
            [600.0, 810.0, 1020.0]
        );
    }

    #[test]
    fn malformed_positions_are_refused() {
        for (from, to, points) in [
            (600.0, 600.0, 2),
            (600.0, 1020.0, 1),
            (-8381.0, 1020.0, 5),
            (600.0, f64::NAN, 5),
            (-115.4, 1020.0, 5),
            (600.0, 600.01, 20),
        ] {
            let error = spread(from, to, points, Spacing::Pixels).expect_err("no positions");
            println!("{error:#}");
        }
        for (text, says) in [
            (
                "600\n610,5\n",
                "line 2: `610,5` is no distance in millimetres",
            ),
            (
                "600\nnan\n",
                "line 2: nan is no distance of a target: it is -8380 to 8380 mm",
            ),
            (
                "600\n# far\n8381\n",
                "line 3: 8381 is no distance of a target: it is -8380 to 8380 mm",
            ),
            (
                "\n# none\n",
                "there are none: write one distance in millimetres a line",
            ),
        ] {
            assert_eq!(format!("{:#}", listed(text).expect_err("refused")), says);
        }
        let twice = listed("600\n610\n600.0 # again\n").expect_err("refused");
        assert!(
            twice
                .to_string()
                .starts_with("line 3: 600.0 is there already"),
            "{twice}"
        );
    }

    #[test]
    fn a_list_is_walked_in_order_from_the_end_it_begins_with() {
        let list = |text| listed(text).expect("positions");
        assert_eq!(
            list("600\n 700.5 # here\n650\n900\n"),
            [600.0, 650.0, 700.5, 900.0]
        );
        assert_eq!(list("900\n600\n650\n"), [900.0, 650.0, 600.0]);
    }

    /// The zero of a stage may be anywhere, and its positions may rise towards the sensor.
    #[test]
    fn the_zero_may_be_anywhere() {
        assert_eq!(
            listed("-210\n-0\n210\n").expect("positions"),
            [-210.0, 0.0, 210.0]
        );
        let even = spread(210.0, -210.0, 3, Spacing::Distance).expect("positions");
        assert_eq!(even, [210.0, 0.0, -210.0]);
        assert!(even[1].is_sign_positive());
        let error = spread(-210.0, 210.0, 3, Spacing::Pixels).expect_err("refused");
        assert!(
            error.to_string().ends_with("give --spacing distance"),
            "{error}"
        );
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
        let mut answers = b"\n 612.5 mm\nsixhundred\ns\nq\n".as_slice();
        let mut mover = Mover::Person {
            input: &mut answers,
        };
        let mut next = || mover.to(610.0, &mut output).expect("an answer");
        assert_eq!(next(), Moved::To(610.0));
        assert_eq!(next(), Moved::To(612.5));
        assert_eq!(next(), Moved::Skip);
        assert_eq!(next(), Moved::Quit);
        assert_eq!(next(), Moved::Quit);
        let output = String::from_utf8(output).expect("text");
        assert!(
            output.starts_with("move the target to 610.000 mm, then Enter;"),
            "{output}"
        );
        assert!(
            output.contains("`sixhundred` is no distance in millimetres\n"),
            "{output}"
        );
    }

    #[test]
    #[cfg(unix)]
    fn a_stage_goes_where_it_is_told() {
        assert!(check_command("stage --to").is_err());
        let directory = tempfile::tempdir().expect("a directory");
        let at = directory.path().join("at");
        let command = format!("echo {{}} > '{}'", at.display());
        let mut mover = Mover::Stage(&command);
        let mut output = Vec::new();
        assert_eq!(
            mover.to(610.0, &mut output).expect("moved"),
            Moved::To(610.0)
        );
        assert_eq!(std::fs::read_to_string(at).expect("written"), "610.000\n");
        let error = Mover::Stage("exit 3 # {}")
            .to(610.0, &mut output)
            .expect_err("fails");
        assert_eq!(
            error.to_string(),
            "the stage's command `exit 3 # 610.000` failed: exit status: 3"
        );
    }
}
