//! Asks a sensor for all that it knows of itself, and says what is wrong and what to do.

use std::io::Write;
use std::process::ExitCode;

use anyhow::Result;
use slitrange::base::exposure::Exposure;
use slitrange::light::ambient::AmbientMode;
use slitrange_device::protocol::command::Command;
use slitrange_device::protocol::info::VERSION;
use slitrange_device::protocol::row_lines::{RowExposure, RowPart};
use slitrange_device::settings::trigger::Trigger;
use slitrange_device::settings::{Setting, Settings, Value};
use statistics::{mean, median};

use super::line::{ANSWER, FRAME};
use super::port::PortOption;
use super::row::{RowAnswer, ask_row};
use super::session::Session;
use crate::pc::Pc;

/// Check a sensor, and say what to do about what is wrong
///
/// The tool asks the sensor for all that it knows of itself, has it check itself, and looks at rows with the
/// laser and without. Each check is a line: ok, or what is wrong and what to do. Begin with the first line
/// that is not ok: those below may follow from it. The sensor's settings are put back, and nothing is saved.
/// A laser that is set off stays off. The exit code is 1 if something is wrong.
#[derive(Clone, Debug, clap::Args)]
pub struct DoctorOptions {
    #[command(flatten)]
    port: PortOption,
}

/// What a sensor says.
struct Said {
    info: Vec<String>,
    status: Vec<String>,
    selftest: Vec<String>,
    calibration: Vec<String>,
    /// A frame's reading or fault, with advice.
    distance: Vec<String>,
    /// Bytes from the PC that came with an error while it was asked.
    spoilt: u32,
    laser_is_set_off: bool,
    /// The map of the pixels is in use. Rows without the laser are not corrected with it.
    has_map: bool,
    /// The user deals with light beside the spot: by `ambient subtract`, `region` or `peak`.
    expects_lamps: bool,
    rows: Option<Rows>,
}

/// What rows show. A sensor without a converter, or whose laser is set off, has none.
struct Rows {
    lit: RowAnswer,
    dark: RowAnswer,
    /// The pixels around the spot in further rows.
    windows: Vec<RowAnswer>,
}

/// `Err`: what is wrong, and what to do about it.
type Finding = Result<String, String>;

/// The name of a check, and its function. `None`: a check before it failed, so this one cannot be done.
type Check = (&'static str, fn(&Said) -> Option<Finding>);

/// In this order: what a check finds may come from what those before it found.
const CHECKS: [Check; 16] = [
    ("firmware", |said| Some(firmware(said))),
    ("line", |said| Some(line(said))),
    ("start", |said| Some(start(said))),
    ("clock", |said| Some(clock(said))),
    ("supply", |said| Some(supply(said))),
    ("flash", |said| tested(said, "flash", "calibration.md")),
    ("timing", |said| Some(timing(said))),
    ("rows", |said| {
        tested(said, "rows", "hardware.md#if-it-fails")
    }),
    ("black", |said| tested(said, "black", "front-end.md")),
    ("noise", |said| tested(said, "noise", "front-end.md")),
    ("pixels", |said| {
        Some(pixels(said.rows.as_ref()?, said.has_map))
    }),
    ("laser", |said| match said.laser_is_set_off {
        true => Some(Err(
            "`laser off` is set: send `laser on`, if its light may be seen".to_owned(),
        )),
        false => said.rows.as_ref().map(laser),
    }),
    ("light", |said| {
        Some(light(said.rows.as_ref()?, said.expects_lamps))
    }),
    ("width", width),
    ("gain", |said| gain(said.rows.as_ref()?, &said.info)),
    ("calibration", |said| Some(calibration(said))),
];

/// What follows these words in a line.
fn value<'a>(lines: &'a [String], words: &str) -> &'a str {
    let mut values = lines.iter().filter_map(|line| line.strip_prefix(words));
    values.next().unwrap_or_default()
}

fn count(lines: &[String], name: &str) -> u32 {
    value(lines, &format!("status {name} "))
        .parse()
        .unwrap_or(0)
}

fn spoilt(status: &[String]) -> u32 {
    let kinds = ["serial noise", "serial framing", "serial overrun"];
    kinds.iter().map(|name| count(status, name)).sum()
}

fn firmware(said: &Said) -> Finding {
    let version = value(&said.info, "info firmware slitrange ");
    match version == VERSION {
        true => Ok(format!(
            "slitrange {version} on {}",
            value(&said.info, "info board ")
        )),
        false => Err(format!(
            "{version}, this tool is {VERSION}: take both from one version (tool.md)"
        )),
    }
}

fn line(said: &Said) -> Finding {
    match said.spoilt {
        0 => Ok("all commands came whole".to_owned()),
        spoilt => Err(format!(
            "{spoilt} bytes came spoilt: a shorter cable, or a common ground (serial-line.md)"
        )),
    }
}

fn start(said: &Said) -> Finding {
    let cause = value(&said.status, "status start ");
    let why = value(&said.info, "info last stop ");
    match cause {
        _ if why.starts_with("the clock") => Err(format!(
            "{why} since the power came: USB of the ST-LINK (computer.md#the-st-links-firmware)"
        )),
        _ if !why.is_empty() => Err(format!(
            "{why}: please report it, then plug out and in (serial-line.md#how-the-sensor-is)"
        )),
        "watchdog" => {
            Err("the firmware hung: please report it (hardware.md#if-it-fails)".to_owned())
        }
        "supply dip" => {
            Err("supply dip: another cable, port or supply (hardware.md#if-it-fails)".to_owned())
        }
        cause => Ok(cause.to_owned()),
    }
}

fn clock(said: &Said) -> Finding {
    match value(&said.info, "info clock ") {
        "external" => Ok("external".to_owned()),
        other => Err(format!(
            "{other}: plug USB into the ST-LINK, and update it (computer.md#the-st-links-firmware)"
        )),
    }
}

fn supply(said: &Said) -> Finding {
    match value(&said.info, "info brown-out reset ") {
        level if level.starts_with("below ") => Ok(format!("the chip resets {level}")),
        level => Err(format!(
            "brown-out reset {level} (hardware.md#supplies-and-jumpers)"
        )),
    }
}

/// What the sensor's own test says. `None`: it could not test that.
fn tested(said: &Said, name: &str, page: &str) -> Option<Finding> {
    let (word, found) = value(&said.selftest, &format!("selftest {name} ")).split_once(' ')?;
    let counts: Option<f64> = found.strip_suffix(" counts").and_then(|it| it.parse().ok());
    let what_to_do = match (name, counts) {
        ("flash", _) => "upload this sensor's calibration, then `save`",
        ("rows", _) => "the converter's supply and wires",
        ("black", Some(counts)) if counts > 1000.0 => "turn the trimmer: ADC_IN is too low",
        ("black", _) => "turn the trimmer: ADC_IN is too high",
        ("noise", Some(counts)) if counts < 1.0 => "the converter's input is not connected",
        _ => "ripple of the supply, ground, wires beside the laser's",
    };
    Some(match word {
        "pass" => Ok(found.to_owned()),
        _ => Err(format!("{found}: {what_to_do} ({page})")),
    })
}

/// The most that rows may be sampled apart, in percent of a pixel.
const SPREAD: u32 = 30;

fn timing(said: &Said) -> Finding {
    const PAGE: &str = "hardware.md#a-slower-core";
    let status = &said.status;
    let [late, failed, lost] =
        ["late", "failed", "lost"].map(|it| count(status, &format!("rows {it}")));
    let spread = value(status, "status sampling spread ").trim_end_matches(" %");
    let found = format!(
        "{late} rows late, {failed} failed, {lost} lost, sampled {spread} % of a pixel apart"
    );
    let is_good = late + failed + lost == 0 && spread.parse().is_ok_and(|it: u32| it <= SPREAD);
    if is_good {
        Ok(found)
    } else {
        Err(format!(
            "{found}: SCLK, and how the firmware was built ({PAGE})"
        ))
    }
}

fn counts(row: &RowAnswer) -> Vec<f64> {
    row.counts.iter().map(|&count| count.into()).collect()
}

/// A pixel may differ from its neighbours by this many counts: ten times the data sheet's noise.
const NOISE: f64 = 40.0;

/// More pixels than this cannot be told from light.
const FEW: usize = 200;

fn pixels(rows: &Rows, has_map: bool) -> Finding {
    let dark = counts(&rows.dark);
    let differs = |it: &&[f64]| {
        let [left, pixel, right] = [it[0], it[1], it[2]];
        pixel > left.max(right) + NOISE || pixel < left.min(right) - NOISE
    };
    match dark.windows(3).filter(differs).count() {
        0 => Ok("none stands out without the laser".to_owned()),
        many if many > FEW => Ok("not checked: light without the laser".to_owned()),
        few if has_map => Ok(format!("{few} stand out, with a map in use")),
        few => Err(format!(
            "{few} stand out without the laser: take a map (calibration.md)"
        )),
    }
}

/// The most light above the median.
fn peak(counts: &[f64]) -> (usize, f64) {
    let level = median(counts);
    let highest = counts
        .iter()
        .copied()
        .enumerate()
        .max_by(|a, b| a.1.total_cmp(&b.1));
    let (pixel, highest) = highest.unwrap_or_default();
    (pixel, highest - level)
}

fn laser(rows: &Rows) -> Finding {
    const PAGE: &str = "exposure.md#wiring-and-safety";
    let (lit, dark) = (counts(&rows.lit), counts(&rows.dark));
    let more = lit.iter().zip(&dark).map(|(lit, dark)| lit - dark);
    let more: Vec<f64> = more.collect();
    let less: Vec<f64> = more.iter().map(|more| -more).collect();
    let [(_, with), (_, without)] = [&more, &less].map(|it| peak(it));
    if without > 2.0 * NOISE && without > with {
        return Err(format!(
            "{without:.0} counts more with `laser off`: the module is inverted ({PAGE})"
        ));
    }
    if with > NOISE {
        return Ok(format!("its light adds {with:.0} counts"));
    }
    let black = rows.dark.black.unwrap_or_default();
    let room = median(&dark) - black;
    let what = match room > 5.0 {
        true => "the laser adds no light: is it lit, and does its spot lie before the sensor?",
        false => {
            "no light at all comes: uncover the sensor; is the laser lit? fM, ICG and SH at U1"
        }
    };
    Err(format!("{what} ({PAGE})"))
}

/// The least height in counts that leaves room for a darker target: a tenth of what auto exposure aims at.
const DIM: f64 = 250.0;

fn is_longest(rows: &Rows) -> bool {
    rows.lit.exposure == RowExposure::On(Exposure::LONGEST)
}

fn light(rows: &Rows, expects_lamps: bool) -> Finding {
    let (pixel, lamp) = peak(&counts(&rows.dark));
    let is_misfit = |row: &&RowAnswer| row.centre.as_ref().is_ok_and(|centre| centre.misfits > 0);
    let misfits = rows.windows.iter().filter(is_misfit).count();
    match &rows.lit.centre {
        Err(error) => Err(format!(
            "{}: {} (serial-line.md#what-you-can-type)",
            error.fault, error.advice
        )),
        _ if lamp > 3.0 * NOISE && !expects_lamps => Err(format!(
            "{lamp:.0} counts at pixel {pixel} without the laser: cover the lamp (ambient-light.md)"
        )),
        Ok(centre) if centre.height_counts < DIM && is_longest(rows) => Err(format!(
            "dim: {:.0} counts at the longest exposure: focus, filter, laser power (exposure.md)",
            centre.height_counts
        )),
        Ok(_) if 2 * misfits > rows.windows.len() => Err(
            "the pixels do not look like a spot: slit, focus (hardware/optics.md#align-it)"
                .to_owned(),
        ),
        Ok(centre) => Ok(format!(
            "a spot of {:.0} counts at pixel {:.1}",
            centre.height_counts, centre.x_px
        )),
    }
}

/// The nominal spot has 7.5 to 8.6 pixels, as sigma.
const WIDE: f64 = 9.0;

/// `None`: no spot, or a comb's. A sensor that was calibrated may have another head.
fn width(said: &Said) -> Option<Finding> {
    let centre = said.rows.as_ref()?.lit.centre.as_ref().ok()?;
    let width = centre.shape?.width_px;
    let is_nominal = value(&said.calibration, "calibration source ") == "default";
    Some(match width {
        WIDE.. if is_nominal => Err(format!(
            "{width:.2} pixels: focus, slit parallel to the pixels (hardware/optics.md#align-it)"
        )),
        _ => Ok(format!("{width:.2} pixels")),
    })
}

/// Counts above the black level from which a pixel tells the noise of light.
const LIGHT: f64 = 100.0;

/// Shot noise tells how many electrons are a count: light over its variance. `None`: too little light.
fn gain(rows: &Rows, info: &[String]) -> Option<Finding> {
    let stated = info.iter().find_map(|line| {
        let (before, _) = line.split_once(" electrons a count")?;
        before.rsplit(' ').next()?.parse::<f64>().ok()
    })?;
    let black = rows.lit.black?;
    // Of pixels beside the spot, and of those with light.
    let (mut noise, mut light, mut variance) = (vec![], vec![], vec![]);
    for pair in rows.windows.windows(2) {
        if pair[0].first != pair[1].first || pair[0].exposure != pair[1].exposure {
            continue;
        }
        let light_of = |row: &RowAnswer| mean(counts(row)) - black;
        // The laser may have become brighter.
        let brighter = light_of(&pair[0]) / light_of(&pair[1]);
        for (a, b) in counts(&pair[0]).into_iter().zip(counts(&pair[1])) {
            let b = black + (b - black) * brighter;
            let (mean, of_pair) = (0.5 * (a + b) - black, 0.5 * (a - b) * (a - b));
            if mean > LIGHT {
                light.push(mean);
                variance.push(of_pair);
            } else {
                noise.push(of_pair);
            }
        }
    }
    if light.len() < 60 || noise.len() < 60 {
        return None;
    }
    let shot_noise = (mean(&variance) - mean(&noise)).max(0.1);
    let electrons = mean(&light) / shot_noise;
    let found =
        format!("{electrons:.0} electrons a count by the light's noise, {stated:.0} stated");
    // A target that moves makes more noise.
    Some(match electrons / stated {
        0.4..2.5 => Ok(found),
        _ => Err(format!(
            "{found}: the amplifier's gain, then `head measure` (front-end.md)"
        )),
    })
}

fn calibration(said: &Said) -> Finding {
    let lines = &said.calibration;
    let of = |key: &str| value(lines, &format!("calibration {key} "));
    let is_flagged = |line: &String| line.split(' ').any(|word| word == "s");
    let estimator = value(&said.info, "info estimator ");
    let what = if !of("fault").is_empty() {
        of("fault")
    } else if of("source") == "default" {
        "nobody calibrated this sensor: calibrate it"
    } else if of("source") == "uploaded" {
        "the record in use is not in flash: `save`"
    } else if lines.iter().any(|line| line == "calibration off") {
        "distances are off: `calibration on`"
    } else if estimator != of("estimator") || said.distance.iter().any(is_flagged) {
        "estimator, black level or slits are not those of the calibration: set them, or calibrate"
    } else {
        return Ok(format!(
            "serial number {}, calibrated {}",
            of("serial"),
            of("date")
        ));
    };
    Err(format!("{what} (calibration.md)"))
}

/// The lines of an answer, up to one that begins with any of these words.
fn ask(session: &mut Session<'_>, command: Command, last: &[&str]) -> Result<Vec<String>> {
    let is_last = |line: &String| last.iter().any(|words| line.starts_with(words));
    let answer = |lines: &[String]| {
        lines
            .last()
            .filter(|it| is_last(it))
            .map(|_| lines.to_vec())
    };
    Ok(session
        .line()
        .ask(&command.to_string(), FRAME.max(ANSWER), answer)?)
}

/// A row with the laser on, or off. A change takes effect some rows later.
fn ask_row_with(session: &mut Session<'_>, laser: bool) -> Result<RowAnswer> {
    session.borrow(Value::Laser(laser))?;
    let mut row = ask_row(session, RowPart::Whole)?;
    for _ in 0..3 {
        if (row.exposure != RowExposure::Off) == laser {
            break;
        }
        row = ask_row(session, RowPart::Whole)?;
    }
    Ok(row)
}

fn listen(session: &mut Session<'_>) -> Result<Said> {
    const LAST_OF_STATUS: [&str; 1] = ["status serial overrun "];
    let before = ask(session, Command::Status, &LAST_OF_STATUS)?;
    session.borrow(Value::Trigger(Trigger::Continuous))?;
    let laser_is_set_off = session.value(Setting::Laser)? == Value::Laser(false);
    let found = session.settings(&[Setting::Ambient, Setting::Region, Setting::SpotChoice])?;
    let factory = Settings::default();
    let has_map = session.map()?.first().is_some_and(|line| line == "flat on");
    let selftest = ask(
        session,
        Command::Selftest,
        &["selftest pass", "selftest fail"],
    )?;
    let is_silent = value(&selftest, "selftest rows ").starts_with("fail");
    let rows = match is_silent || laser_is_set_off {
        true => None,
        false => {
            session.borrow(Value::Ambient(AmbientMode::Off))?;
            let dark = ask_row_with(session, false)?;
            session.borrow(found.get(Setting::Ambient))?;
            let lit = ask_row_with(session, true)?;
            session.borrow(Value::Ambient(AmbientMode::Off))?;
            let windows = (0..12).map(|_| ask_row(session, RowPart::Window));
            let windows = windows.collect::<Result<_>>()?;
            Some(Rows { lit, dark, windows })
        }
    };
    session.borrow(Value::Output(factory.output))?;
    let distance = ask(session, Command::Distance, &["d ", "z ", "("])?;
    let info = ask(
        session,
        Command::Info,
        &[
            "info uncertainty motion",
            "info calibration none",
            "info calibration off",
        ],
    )?;
    let calibration = ask(
        session,
        Command::Calibration(None),
        &["calibration stored "],
    )?;
    let status = ask(session, Command::Status, &LAST_OF_STATUS)?;
    Ok(Said {
        info,
        selftest,
        calibration,
        distance,
        spoilt: spoilt(&status).saturating_sub(spoilt(&before)),
        status,
        laser_is_set_off,
        has_map,
        expects_lamps: found != factory,
        rows,
    })
}

/// `doctor`.
pub fn doctor(options: &DoctorOptions, pc: &dyn Pc, output: &mut dyn Write) -> Result<ExitCode> {
    let mut session = options.port.open(pc)?;
    let firmware = format!("sensor {} at {}", session.head(), session.port());
    writeln!(output, "{firmware}")?;
    let said = listen(&mut session)?;
    let mut wrong = 0;
    for (name, check) in CHECKS {
        match check(&said) {
            Some(Ok(found)) => writeln!(output, "ok    {name}: {found}")?,
            Some(Err(what)) => {
                wrong += 1;
                writeln!(output, "WRONG {name}: {what}")?;
            }
            None => writeln!(output, "skip  {name}: see the lines above")?,
        }
    }
    Ok(match wrong {
        0 => ExitCode::SUCCESS,
        _ => ExitCode::FAILURE,
    })
}
