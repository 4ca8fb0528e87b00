//! A map of the pixels that differ, taken with a person who darkens and lights the sensor.

use std::io::{BufRead, Write};

use anyhow::{Context, Result, ensure};
use slitrange::row::pixels::flat_field::Kind;
use slitrange_device::protocol::flat::Flat;

use super::answers;
use super::line::{FRAME, LineError, SAVE};
use super::port::PortOption;
use super::session::Session;
use crate::pc::Pc;

/// Take a map of the pixels that differ, use it and save it
///
/// Each pixel of a sensor has a response and an offset of its own, which move the centre of every row the
/// same way. The sensor takes 256 dark rows, then 256 rows with even light, and from then on corrects its
/// rows. Take the map before the calibration, because it moves centres by hundredths of a pixel.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
For a script, in two runs:
  slitrange head flat --port /dev/ttyACM0 --only dark
  slitrange head flat --port /dev/ttyACM0 --only lit")]
pub struct FlatOptions {
    #[command(flatten)]
    port: PortOption,
    /// Take only these rows, and ask nothing: dark rows first, lit rows in another run
    #[arg(long, value_enum)]
    only: Option<Only>,
    /// Leave the flash as it is: the map is used until the power goes
    #[arg(long)]
    no_save: bool,
}

/// The rows that one run takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Only {
    /// Rows without light
    Dark,
    /// Rows with even light, and the map
    Lit,
}

/// `head flat`.
pub fn flat(
    options: &FlatOptions,
    pc: &dyn Pc,
    input: &mut dyn BufRead,
    output: &mut dyn Write,
) -> Result<()> {
    let mut session = options.port.open(pc)?;
    writeln!(output, "sensor {} at {}", session.head(), session.port())?;
    for (kind, only, what_to_do) in [
        (
            Kind::Dark,
            Only::Dark,
            "Switch the laser off and cover the sensor, so that no light reaches it.",
        ),
        (
            Kind::Lit,
            Only::Lit,
            "Leave the laser off, remove the slit, and let a white sheet that a lamp lights fill the \
             sensor's view.\nDaylight or a lamp on direct current is best. Aim at half of full scale.",
        ),
    ] {
        match options.only {
            None => take_with_person(&mut session, kind, what_to_do, input, output)?,
            Some(wanted) if wanted == only => writeln!(output, "{}", take(&mut session, kind)?)?,
            Some(_) => {}
        }
    }
    if options.only == Some(Only::Dark) {
        return Ok(());
    }
    for line in session.map()? {
        writeln!(output, "{line}")?;
    }
    if options.no_save {
        writeln!(output, "not saved: the map is used until the power goes")?;
    } else {
        let saved = session.has_done(&Flat::Save.to_string(), SAVE);
        saved.context("the map is in use, but not saved")?;
        writeln!(output, "saved: the map is kept over a power cycle")?;
    }
    let next = "Put the slit back. Then calibrate: slitrange calibrate run";
    Ok(writeln!(output, "{next}")?)
}

/// Asks the person for darkness or light until the sensor accepts its rows.
fn take_with_person(
    session: &mut Session<'_>,
    kind: Kind,
    what_to_do: &str,
    input: &mut dyn BufRead,
    output: &mut dyn Write,
) -> Result<()> {
    loop {
        writeln!(output, "{what_to_do}\nThen press Enter.")?;
        output.flush()?;
        let mut typed = String::new();
        ensure!(
            input.read_line(&mut typed)? > 0,
            "nobody pressed Enter: nothing was saved; for a script, take --only dark, then --only lit"
        );
        match take(session, kind) {
            Ok(answer) => return Ok(writeln!(output, "{answer}")?),
            Err(LineError::Refused { answer, .. }) if answer.starts_with("E20 ") => {
                writeln!(output, "{answer}")?;
            }
            Err(error) => return Err(error.into()),
        }
    }
}

/// Takes rows. Gives the sensor's answer: `flat dark 300.1 counts`.
fn take(session: &mut Session<'_>, kind: Kind) -> Result<String, LineError> {
    let command = Flat::Take(kind).to_string();
    (session.line()).ask(&command, FRAME, |lines| answers::taken(lines, &command))
}
