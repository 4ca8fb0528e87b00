//! The answers to `help` and `help estimator`.

use core::fmt::{self, Write as _};

use crate::settings::{Setting, split_words};
use crate::text::Text;
use slitrange::base::units::Units;
use slitrange::centre::Estimator;

/// The commands that `help` shows before the settings. Each has its form, a tab, and its effect.
const BEFORE_SETTINGS: [&str; 13] = [
    "help [estimator]\tthis list, or what each estimator is for",
    "info\twhat this sensor is, its calibration and its range",
    "status\trows, the slowest row, readings, faults, errors, and why it started",
    "errors\tthe errors in `status` alone",
    "uptime\tthe time since the start",
    "selftest\tcheck flash, a row and its light, and the start",
    "distance\tthe next frame's reading, or its fault and what to do about it",
    "measure\tstart a frame, unless `trigger` is continuous",
    "centre\tthe next frame's centre and the spot's shape, or its fault",
    "uncertainty\tthe next frame's reading with the parts of its uncertainty",
    "row [window|FIRST LAST]\tone row's pixels and centre: all, the spot's, or FIRST to LAST; pauses",
    "zero [off]\tgive distances relative to the next frame's; off: from the laser again",
    "master [VALUE]\tas zero, with the distance VALUE in place of 0; alone: show it",
];

/// The commands that `help` shows after the settings, like those before.
const AFTER_SETTINGS: [&str; 11] = [
    "calibration [on|off]\tshow the calibration; on: give distances, off: centres only",
    "calibration begin BYTES\tstart the upload of a record of so many bytes, to RAM only",
    "calibration data OFFSET [HEX CRC16]\tread a piece of the record in use, or send a piece of a new one",
    "calibration commit|abort\tuse the uploaded record, or drop it",
    "save\twrite settings and calibration to flash; pauses the stream",
    "save nominal\tthe same with the nominal calibration, over the stored one",
    "defaults\tuse the factory's settings and the nominal calibration, in RAM only",
    "flat [on|off]\tshow the map of the pixels that differ; correct rows with it, or not",
    "flat dark|lit\ttake dark rows, then evenly lit rows for a map, in RAM only; pauses",
    "flat save|none\twrite the map to flash, or erase it; pauses the stream",
    "reset\tstart the sensor again; it loses what was not saved",
];

const LAST: &str = "\
    a name alone shows its value; f is a fault; d is a reading, z one relative to zero:\r\n\
    u uncertainty, r repeatability, x centre, a height, n rows used,\r\n\
    # number of the result, @ its time in us, w width, t exposure in us, k slits used; and flags:\r\n\
    m rows misfit, c rows correlated, g never calibrated, s not as calibrated, h held";

/// The width of what is typed. Longer forms move their explanation: padding costs bytes of the answer.
const COLUMN: usize = 24;

/// Splits such a command into its form and its effect.
fn parts(line: &str) -> (&str, &str) {
    // As a list: the search for a single character has a panic that the compiler cannot exclude.
    line.split_once(['\t']).unwrap_or((line, ""))
}

/// The commands of `help` but for the settings: what is typed, and what each does.
pub fn commands() -> impl Iterator<Item = (&'static str, &'static str)> {
    let commands = BEFORE_SETTINGS.iter().chain(&AFTER_SETTINGS);
    commands.map(|line| parts(line))
}

/// The first words of all commands and settings.
pub fn names() -> impl Iterator<Item = &'static str> {
    let settings = Setting::ALL.iter().map(|it| it.name());
    let (before, after) = (BEFORE_SETTINGS.into_iter(), AFTER_SETTINGS.into_iter());
    (before.chain(settings).chain(after)).filter_map(|typed| split_words(typed).first().copied())
}

fn write_line(f: &mut fmt::Formatter<'_>, (typed, help): (&str, &str)) -> fmt::Result {
    write!(f, "{typed:COLUMN$} {help}\r\n")
}

/// The answer to `help`: a line for each command, parted by CR LF. Lengths are in this unit.
#[derive(Clone, Copy, Debug)]
pub struct Help(pub Units);

impl fmt::Display for Help {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for line in &BEFORE_SETTINGS {
            write_line(f, parts(line))?;
        }
        for &setting in Setting::ALL {
            let mut typed = Text::<96>::default();
            // A test checks that all fit.
            let form = setting.form().in_units(self.0);
            let _ = write!(typed, "{} [{form}]", setting.name());
            write_line(f, (typed.as_str(), setting.help()))?;
        }
        for line in &AFTER_SETTINGS {
            write_line(f, parts(line))?;
        }
        f.write_str(LAST)
    }
}

/// The answer to `help estimator`: a line for each estimator, parted by CR LF. A line begins with `e` and the
/// letter, as the line of a reading ends. So nobody takes it for a fault, as could happen with
/// `f fraunhofer`. docs/accuracy.md says what each costs and gives.
#[derive(Clone, Copy, Debug)]
pub struct Estimators;

impl fmt::Display for Estimators {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut end = "";
        for estimator in Estimator::ALL {
            let (letter, name) = (estimator.letter(), estimator.name());
            write!(f, "{end}e {letter} {name:13} {}", purpose(estimator))?;
            end = "\r\n";
        }
        Ok(())
    }
}

/// What an estimator is for.
pub const fn purpose(estimator: Estimator) -> &'static str {
    match estimator {
        Estimator::Centroid => "eq. (2), for comparison; subtracts the black level",
        Estimator::PhaseTable => "one set of weights for every row; for skewed lasers",
        Estimator::Adaptive => "the default: weights that follow width, noise, tilt and asymmetry",
        Estimator::GaussNewton => "the paper's fit, eq. (5); reads spots that are cut off",
        Estimator::Fraunhofer => "eq. (6), for laser spots below 1 mm",
    }
}
