//! A map of the pixels that differ, taken with a person who covers and lights the sensor.

use std::io::{BufRead, Write};
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use slitrange::row::pixels::flat_field::Kind;
use slitrange_device::protocol::flat::Flat;
use slitrange_device::settings::{Setting, Value};

use super::answers;
use super::line::{FRAME, LineError, SAVE};
use super::port::PortOption;
use super::positions;
use super::session::Session;
use crate::pc::Pc;

/// In this time the sensor reads the rows that were lit before the laser went off: less than ten, of 5.7 ms.
const UNDER_WAY: Duration = Duration::from_millis(100);

/// Take a map of the pixels that differ, use it and save it
///
/// Each pixel of a sensor has a response and an offset of its own, which move the centre of every row the
/// same way. The sensor takes 256 dark rows, then 256 rows with even light, and from then on corrects its
/// rows. The laser is off meanwhile, and as it was afterwards. Take the map before the calibration, because
/// it moves centres by hundredths of a pixel.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = include_str!("flat.help.txt").trim_ascii_end())]
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
    // From now on, Ctrl-C ends the input, and the laser is put back.
    pc.interrupted();
    let mut session = options.port.open(pc)?;
    writeln!(output, "sensor {} at {}", session.head(), session.port())?;
    session.borrow(Value::Laser(false))?;
    pc.sleep(UNDER_WAY);
    writeln!(output, "the laser is off until this command ends")?;
    for (kind, only, what_to_do) in [
        (
            Kind::Dark,
            Only::Dark,
            "\nStep 1 of 2: cover the sensor, so that no light reaches it.",
        ),
        (
            Kind::Lit,
            Only::Lit,
            "\nStep 2 of 2: uncover the sensor, take the slit off, and put a white sheet all over its view.\n\
             Light the sheet with daylight or a lamp on direct current, to about 2000 counts above the dark.",
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
    let unsaved = "stopped by Ctrl-C: the map is in use, but not saved";
    ensure!(!pc.interrupted(), unsaved);
    if options.no_save {
        writeln!(output, "not saved: the map is used until the power goes")?;
    } else {
        let saved = session.has_done(&Flat::Save.to_string(), SAVE);
        saved.context("the map is in use, but not saved")?;
        writeln!(output, "saved: the map is kept over a power cycle")?;
    }
    session.give_back(&[Setting::Laser])?;
    let next =
        "The laser is as it was before. Put the slit back. Then calibrate: slitrange calibrate run";
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
        let typed = positions::read(input, output)?;
        let is_interrupted = session.line().pc().interrupted();
        ensure!(!is_interrupted, "stopped by Ctrl-C: nothing was saved");
        ensure!(
            typed.is_some(),
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
