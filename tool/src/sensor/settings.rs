//! The settings of a sensor: shown, changed, saved, written to a file, taken from it, and compared.
//!
//! All follows from the core's declaration of the settings ([`Setting::ALL`]). A new setting needs no line
//! here.

use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use calibration::points::words;
use slitrange::base::units::Units;
use slitrange_device::protocol::command::{Command, Error, parse_in};
use slitrange_device::settings::serial_line::Format;
use slitrange_device::settings::{Affects, Form, Setting, Settings, Value};

use super::line::SAVE;
use super::port::PortOption;
use super::session::Session;
use crate::pc::Pc;
use crate::screen::wrap;
use crate::whole_file;

/// The table of all settings fits in so many columns of a terminal.
const WIDTH: usize = 100;
/// The columns of the table for a setting's value.
const VALUE_WIDTH: usize = 24;
/// Between the table's columns.
const GAP: &str = "  ";

/// Show, change, export, import and compare the settings of a sensor
///
/// Without a command: all settings, with the factory's values and what may be set. A change is in RAM only,
/// until --save, or `save` on the sensor's line, writes it to flash.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = include_str!("settings.help.txt").trim_ascii_end())]
pub struct SettingsOptions {
    #[command(subcommand)]
    command: Option<SettingsCommand>,
    #[command(flatten)]
    port: PortOption,
}

/// The commands of `slitrange settings`.
#[derive(Clone, Debug, clap::Subcommand)]
enum SettingsCommand {
    /// Print the value of a setting
    Get {
        /// The setting's name, of one word or two
        #[arg(required = true)]
        name: Vec<String>,
    },
    /// Change a setting
    Set {
        /// The setting's name and its value, as on the sensor's line: `rows 64`, `black fixed 300`
        #[arg(required = true, value_names = ["NAME", "VALUE"])]
        words: Vec<String>,
        /// Have the sensor save its settings and its calibration to flash
        #[arg(long)]
        save: bool,
    },
    /// Write to a file all settings that the sensor can save
    Export {
        /// A TOML file. An existing one is replaced
        file: PathBuf,
    },
    /// Send the settings of a file. Nothing is sent if one of them is wrong
    Import {
        /// A TOML file, as `settings export` writes it. Settings that it does not name stay as they are
        file: PathBuf,
        /// Have the sensor save its settings and its calibration to flash
        #[arg(long)]
        save: bool,
    },
    /// Compare with a file or with another sensor. The exit code is 1 if they differ, 2 after an error
    Compare {
        /// A TOML file
        #[arg(required_unless_present = "with")]
        file: Option<PathBuf>,
        /// The serial port of another sensor
        #[arg(long, value_name = "PORT", conflicts_with = "file")]
        with: Option<String>,
    },
}

/// `settings`.
pub fn settings(
    options: &SettingsOptions,
    pc: &dyn Pc,
    output: &mut dyn Write,
) -> Result<ExitCode> {
    match &options.command {
        None => show(&mut options.port.open(pc)?, output)?,
        Some(SettingsCommand::Get { name }) => {
            let setting = named(name)?;
            let mut session = options.port.open(pc)?;
            let (value, units) = (value(&mut session, setting)?, units(&mut session)?);
            writeln!(output, "{}", words_in(value, units))?;
        }
        Some(SettingsCommand::Set { words, save }) => {
            let line = words.join(" ");
            let mut session = None;
            // Only where the unit matters, the sensor is asked for its own.
            let value = match [Units::Millimetres, Units::Micrometres].map(|it| read(it, &line)) {
                [Ok(mm), Ok(um)] if mm == um => mm,
                [Err(mm), Err(um)] if mm.to_string() == um.to_string() => return Err(mm),
                _ => {
                    let session = session.insert(options.port.open(pc)?);
                    read(units(session)?, &line)?
                }
            };
            ensure_alone(value)?;
            let mut session = session.map_or_else(|| options.port.open(pc), Ok)?;
            set(&mut session, value, *save, output)?;
        }
        Some(SettingsCommand::Export { file }) => {
            export(&mut options.port.open(pc)?, file, output)?
        }
        Some(SettingsCommand::Import { file, save }) => {
            let values = read_file(file)?;
            values.iter().try_for_each(|&value| ensure_alone(value))?;
            import(&mut options.port.open(pc)?, &values, *save, output)?;
        }
        Some(SettingsCommand::Compare { file, with }) => {
            let (theirs, name) = match (file, with) {
                (Some(file), _) => (read_file(file)?, file.display().to_string()),
                (None, Some(port)) => (all(&mut Session::open(pc, port)?)?, port.clone()),
                (None, None) => bail!("name a file, or a port --with"),
            };
            let mut session = options.port.open(pc)?;
            let ours = all(&mut session)?;
            return compare((&ours, session.port()), (&theirs, &name), output);
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn named(words: &[String]) -> Result<Setting> {
    let name = words.join(" ").to_ascii_lowercase();
    let setting = Setting::ALL.iter().find(|setting| setting.name() == name);
    let unknown = || format!("`{name}` is no setting. {}", names());
    setting.copied().with_context(unknown)
}

fn names() -> String {
    let names: Vec<&str> = Setting::ALL.iter().map(|setting| setting.name()).collect();
    format!("The settings are: {}", names.join(", "))
}

/// Reads a line that sets a value. Lengths without a unit are in `units`.
fn read(units: Units, line: &str) -> Result<Value> {
    match parse_in(units, line.as_bytes()) {
        Ok(Command::Set(value)) => Ok(value),
        Ok(Command::Show(it)) => {
            let form = it.form().in_units(units);
            bail!("`{line}` lacks the value: {} {form}", it.name())
        }
        Ok(_) | Err(Error::Unknown(_)) => bail!("`{line}` is no setting. {}", names()),
        Err(error) => {
            let error = error.to_string();
            // The number is for programs.
            let words = error.split_once(' ').map(|(_, words)| words);
            bail!("`{line}`: {}", words.unwrap_or(&error))
        }
    }
}

/// Refuses a value with which the sensor would no longer answer the tool.
fn ensure_alone(value: Value) -> Result<()> {
    let is_alone = match value {
        Value::Address(address) => address == 0,
        Value::Format(format) => format != Format::Modbus,
        _ => true,
    };
    ensure!(
        is_alone,
        "`{value}` is not set here: the tool talks to a sensor that is alone on its line: `address 0`, and \
         not `format modbus`"
    );
    Ok(())
}

/// Asks for a value as it was before the session.
fn value(session: &mut Session<'_>, setting: Setting) -> Result<Value> {
    match session.found(setting) {
        Some(value) => Ok(value),
        None => Ok(session.value(setting)?),
    }
}

/// The unit in which the sensor's lines have lengths.
fn units(session: &mut Session<'_>) -> Result<Units> {
    match value(session, Setting::Units)? {
        Value::Units(units) => Ok(units),
        _ => Ok(Units::default()),
    }
}

/// A value as the sensor's line has it, without the setting's name.
fn words_in(value: Value, units: Units) -> String {
    let line = value.in_units(units).to_string();
    line[value.setting().name().len()..].trim_start().to_owned()
}

/// All settings that flash can hold but the sensor's address, which another sensor has otherwise.
fn all(session: &mut Session<'_>) -> Result<Vec<Value>> {
    let is_held = |it: &&Setting| !matches!(it.affects(), Affects::Session | Affects::Connection);
    let held = Setting::ALL.iter().filter(is_held);
    held.map(|&setting| value(session, setting)).collect()
}

fn show(session: &mut Session<'_>, output: &mut dyn Write) -> Result<()> {
    writeln!(output, "sensor {} at {}", session.head(), session.port())?;
    let mut rows = vec![["setting", "value", "what it sets: values"].map(str::to_owned)];
    let (factory, units) = (Settings::default(), units(session)?);
    let words = |value| words_in(value, units);
    for &setting in Setting::ALL {
        let value = value(session, setting)?;
        let default = factory.get(setting);
        let (mark, of_factory) = match value == default {
            true => ("", String::new()),
            false => (" *", format!("; factory {}", words(default))),
        };
        rows.push([
            setting.name().to_owned(),
            format!("{}{mark}", words(value)),
            format!(
                "{}: {}{of_factory}",
                setting.help(),
                setting.form().in_units(units)
            ),
        ]);
    }
    let names = rows.iter().map(|[name, ..]| name.len()).max();
    let name_width = names.unwrap_or_default();
    let help_width = WIDTH.saturating_sub(name_width + VALUE_WIDTH + 2 * GAP.len());
    for [name, value, help] in &rows {
        let (values, helps) = (wrap(value, VALUE_WIDTH), wrap(help, help_width));
        for place in 0..values.len().max(helps.len()) {
            let name = if place == 0 { name } else { "" };
            let part = |lines: &[String]| lines.get(place).cloned().unwrap_or_default();
            let line = format!(
                "{name:name_width$}{GAP}{:VALUE_WIDTH$}{GAP}{}",
                part(&values),
                part(&helps)
            );
            writeln!(output, "{}", line.trim_end())?;
        }
    }
    Ok(writeln!(output, "* differs from the factory's")?)
}

fn set(session: &mut Session<'_>, new: Value, saves: bool, output: &mut dyn Write) -> Result<()> {
    let (before, units) = (value(session, new.setting())?, units(session)?);
    let shown = new.in_units(units);
    if before == new {
        writeln!(output, "{shown} (as before)")?;
    } else {
        let remark = session.set_for_good(new)?;
        writeln!(output, "{shown} (it was {})", words_in(before, units))?;
        remark.map_or(Ok(()), |remark| writeln!(output, "{remark}"))?;
    }
    if saves {
        return save(session, output);
    }
    if before != new && new.setting().affects() != Affects::Session {
        writeln!(output, "in RAM only: --save keeps it over a power cycle")?;
    }
    Ok(())
}

fn save(session: &mut Session<'_>, output: &mut dyn Write) -> Result<()> {
    let saved = session.has_done(&Command::Save.to_string(), SAVE);
    saved.context("the settings are in use, but not saved")?;
    Ok(writeln!(
        output,
        "saved: the settings are kept over a power cycle"
    )?)
}

fn export(session: &mut Session<'_>, file: &Path, output: &mut dyn Write) -> Result<()> {
    let values = all(session)?;
    whole_file::write(file, to_toml(&values).as_bytes())?;
    let (file, count) = (file.display(), values.len());
    Ok(writeln!(output, "written: {file}, {count} settings")?)
}

/// The file of some values, with what may be set behind each.
fn to_toml(values: &[Value]) -> String {
    let mut toml =
        "# Settings of a slitrange sensor. `slitrange settings import FILE` sends them.\n\n"
            .to_owned();
    for &value in values {
        let setting = value.setting();
        let key = match setting.name() {
            name if name.contains(' ') => format!("\"{name}\""),
            name => name.to_owned(),
        };
        let text = words(value);
        let text = match text.parse::<i64>() {
            Ok(number) => toml::Value::Integer(number),
            Err(_) => toml::Value::String(text),
        };
        let (help, form) = (setting.help(), setting.form());
        let _ = writeln!(toml, "# {help}: {form}\n{key} = {text}");
    }
    toml
}

fn read_file(file: &Path) -> Result<Vec<Value>> {
    let name = file.display();
    let text = std::fs::read_to_string(file).with_context(|| format!("{name} cannot be read"))?;
    from_toml(&text).with_context(|| name.to_string())
}

fn from_toml(text: &str) -> Result<Vec<Value>> {
    let table: toml::Table = text.parse()?;
    let mut values = Vec::new();
    let mut errors = Vec::new();
    for (name, value) in table {
        let value = match value {
            toml::Value::Integer(number) => number.to_string(),
            toml::Value::String(words) => words,
            toml::Value::Boolean(true) => "on".to_owned(),
            toml::Value::Boolean(false) => "off".to_owned(),
            other => other.to_string(),
        };
        let read = named(&[name]).and_then(|setting| read_value(setting, &value));
        match read {
            Ok(value) => values.push(value),
            Err(error) => errors.push(format!("{error:#}")),
        }
    }
    ensure!(errors.is_empty(), "{}", errors.join("\n"));
    ensure!(!values.is_empty(), "the file names no setting");
    // In the order of the declaration, whatever the file's.
    values.sort_by_key(|value| Setting::ALL.iter().position(|&it| it == value.setting()));
    Ok(values)
}

fn read_value(setting: Setting, words: &str) -> Result<Value> {
    let line = format!("{} {words}", setting.name());
    let [mm, um] = [Units::Millimetres, Units::Micrometres].map(|units| read(units, &line));
    let is_clear = matches!((&mm, &um), (Ok(mm), Ok(um)) if mm == um);
    ensure!(
        is_clear || !matches!(setting.form(), Form::Lengths { .. }),
        "`{line}` has no unit, or no value: write `{words} mm`, or `{words} um` as older files mean"
    );
    let value = mm?;
    ensure!(
        value.setting() == setting,
        "`{words}` is no value of `{}`",
        setting.name()
    );
    Ok(value)
}

fn import(
    session: &mut Session<'_>,
    values: &[Value],
    saves: bool,
    output: &mut dyn Write,
) -> Result<()> {
    let mut changes = Vec::new();
    for &new in values {
        let before = value(session, new.setting())?;
        if before != new {
            changes.push((before, new));
        }
    }
    for &(before, new) in &changes {
        let sent = session.set_for_good(new);
        let remark =
            sent.context("some settings were sent, some were not: import the file again")?;
        let (name, before, new) = (new.setting().name(), words(before), words(new));
        writeln!(output, "{name}: {before} -> {new}")?;
        remark.map_or(Ok(()), |remark| writeln!(output, "{remark}"))?;
    }
    let (count, same) = (changes.len(), values.len() - changes.len());
    let what = if count == 1 { "setting" } else { "settings" };
    writeln!(output, "{count} {what} changed, {same} as before")?;
    if saves {
        save(session, output)?;
    }
    Ok(())
}

fn compare(
    (ours, here): (&[Value], &str),
    (theirs, there): (&[Value], &str),
    output: &mut dyn Write,
) -> Result<ExitCode> {
    let (mut compared, mut different) = (0, 0);
    for &their in theirs {
        let setting = their.setting();
        let Some(&our) = ours.iter().find(|value| value.setting() == setting) else {
            continue;
        };
        compared += 1;
        if our != their {
            different += 1;
            let (name, our, their) = (setting.name(), words(our), words(their));
            writeln!(output, "{name}: {our} at {here}, {their} in {there}")?;
        }
    }
    writeln!(output, "{different} of {compared} settings differ")?;
    Ok(ExitCode::from(u8::from(different > 0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_holds_each_setting_and_is_read_again() {
        let factory = Settings::default();
        let values: Vec<Value> = Setting::ALL.iter().map(|&it| factory.get(it)).collect();
        let toml = to_toml(&values);
        println!("{toml}");
        let mut read = from_toml(&toml).expect("a file");
        assert_eq!(read.len(), values.len());
        read.retain(|value| !values.contains(value));
        assert_eq!(read, []);
    }

    #[test]
    fn every_wrong_line_of_a_file_is_named() {
        let error = from_toml("rows = 65\nblack = \"fixed\"\ncolour = \"red\"\nmean = \"plain\"\n");
        let error = format!("{:#}", error.expect_err("three wrong lines"));
        // The list of all settings grows.
        let lines = error.lines();
        let lines = lines.map(|it| it.split(" The settings are: ").next());
        insta::assert_debug_snapshot!(lines.collect::<Vec<_>>());
        let limit = "exposure = \"limit 20\"";
        for text in ["", "rows", "rows = [1]", "rows = 1.5", limit] {
            let error = format!("{:#}", from_toml(text).expect_err("wrong"));
            println!("{error}");
        }
    }

    #[test]
    fn a_boolean_is_on_or_off() {
        let values = from_toml("laser = false").expect("a value");
        assert_eq!(values, [Value::Laser(false)]);
    }
}
