//! Records between sensors and files.

use std::fmt::Display;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use calibration::record::verdict;
use serde::Serialize;
use slitrange::frame::comb::Slits;
use slitrange_device::protocol::command::{Command, parse};
use slitrange_device::protocol::piece::{PIECE, Piece};
use slitrange_device::protocol::upload::Step;
use slitrange_device::record::encoded::EncodedRecord;
use slitrange_device::record::{Record, decode};
use slitrange_device::settings::Value;

use super::answers::InUse;
use super::line::{ANSWER, LineError, SAVE, is_echoed};
use super::port::PortOption;
use super::session::Session;
use crate::pc::Pc;
use crate::record_file::{self, Comparison, Shown, ShownFrontEnd};
use crate::whole_file;

/// How often a transfer begins anew if the sensor goes away in it, and how often the sensor is asked to save.
const TRIES: usize = 3;

/// Write a record to the sensor: upload it, read it back, compare, and save it
///
/// FILE is what `calibrate fit` or `calibrate read` wrote. The sensor uses the record when all of it has come
/// and is sound, or goes on with the one it had. Its estimator and black level are set as when it was
/// calibrated. `save` keeps them over a power cycle, and with them the rows in a frame and their mean, as
/// they are set. If FILE has no front end and `head measure` measured that of the sensor, the sensor keeps
/// what was measured.
#[derive(Clone, Debug, clap::Args)]
pub struct WriteOptions {
    /// The record
    file: PathBuf,
    #[command(flatten)]
    port: PortOption,
    /// Leave the flash as it is: the record is used until the power goes
    #[arg(long)]
    no_save: bool,
    /// Write a calibration that is not usable, too
    #[arg(long)]
    force: bool,
}

/// Read the record that the sensor uses, show it, and write it to a file
#[derive(Clone, Debug, clap::Args)]
pub struct ReadOptions {
    #[command(flatten)]
    port: PortOption,
    /// The file to write
    #[arg(short, long, value_name = "FILE", value_parser = whole_file::output)]
    output: Option<PathBuf>,
    /// Replace FILE even if something else is in it
    #[arg(long, requires = "output")]
    force: bool,
}

/// Show a record, of a file or of a sensor, or how two of them differ
///
/// With two files, or a file and a port: what they say otherwise than each other, and by how much their
/// distances differ. The exit code is then 0 if they are the same bit for bit, 1 if they differ, and 2 if one
/// of them cannot be read.
#[derive(Clone, Debug, clap::Args)]
#[command(override_usage = "\
slitrange calibrate show FILE
       slitrange calibrate show --port PORT
       slitrange calibrate show FILE FILE
       slitrange calibrate show FILE --port PORT")]
pub struct ShowOptions {
    /// Records
    #[arg(value_name = "FILE", num_args = 0..=2, required_unless_present = "port")]
    files: Vec<PathBuf>,
    /// A sensor's serial port: the record that it uses
    #[arg(long)]
    port: Option<String>,
    /// For programs
    #[arg(long)]
    json: bool,
}

/// `calibrate write`.
///
/// # Errors
/// In sentences: the sensor uses the record that it had, or the new one, as is said.
pub fn write(options: &WriteOptions, pc: &dyn Pc, output: &mut dyn Write) -> Result<()> {
    let from_file = record_file::read(&options.file)?;
    let against = verdict::against(from_file.record());
    if let Some(reason) = against.as_ref().filter(|_| !options.force) {
        bail!(
            "{} is not written, its calibration is not usable: {reason} (--force writes it all the same)",
            options.file.display()
        );
    }
    let mut session = options.port.open(pc)?;
    let before = session.calibration()?;
    let front_end = match (from_file.record().front_end, &before.record) {
        (None, Some(in_use)) if in_use.may_have_front_end => {
            record_in_use(&mut session)?.record().front_end
        }
        _ => None,
    };
    let written = match front_end {
        None => from_file,
        Some(_) => EncodedRecord::new(Record {
            front_end,
            ..from_file.record().clone()
        })?,
    };
    let record = written.record();
    let (bytes, sum) = (written.bytes().len(), written.sum());
    let (number, date) = (record.serial_number, record.date);
    let (head, port) = (session.head(), session.port());
    writeln!(
        output,
        "record of sensor {number}, {date}, {bytes} bytes, CRC-32 {sum:08x}, for the sensor {head} at {port}"
    )?;
    if let Some(reason) = against {
        writeln!(output, "mind: the calibration is not usable: {reason}")?;
    }
    let other = before.record.map(|it| it.serial_number);
    if let Some(other) = other.filter(|it| ![0, number].contains(it)) {
        let mind = "mind: the sensor's calibration until now was that of sensor";
        writeln!(output, "{mind} {other}")?;
    }
    match (front_end, record.front_end) {
        (Some(_), _) => writeln!(
            output,
            "with the front end that was measured on this sensor"
        )?,
        (None, Some(of_file)) => writeln!(
            output,
            "mind: the front end of FILE replaces that of the sensor: {}",
            ShownFrontEnd::of(&of_file)
        )?,
        (None, None) if before.stored == "other" => writeln!(
            output,
            "mind: flash holds another record than the one in use. If its front end was measured, measure it \
             again: slitrange head measure"
        )?,
        (None, None) => {}
    }
    transfer(session, &written, &[], !options.no_save)?;
    let slits = match record.slits() {
        Slits::One => String::new(),
        comb => format!(", {}", Value::Slits(comb)),
    };
    writeln!(
        output,
        "uploaded and in use; read back, it is the same bit for bit. Set with it: estimator {}, {}{slits}",
        record.estimator.name(),
        Value::Black(record.black_level)
    )?;
    let kept = match options.no_save {
        true => "not saved: it is used until the power goes",
        false => "saved: it is kept over a power cycle",
    };
    Ok(writeln!(output, "{kept}")?)
}

/// Uploads a record, checks it, sets some settings that an upload changes, and has all of it saved, if it is
/// to be; again from the beginning if the sensor goes away meanwhile.
pub(super) fn transfer(
    mut session: Session<'_>,
    written: &EncodedRecord,
    settings: &[Value],
    and_save: bool,
) -> Result<()> {
    let mut tries = 1;
    loop {
        // A try before this one may have got as far as the flash.
        let if_not_uploaded = match tries {
            1 => "nothing has changed, the sensor uses the calibration that it had",
            _ => "`calibrate show`, with FILE and --port, tells which calibration the sensor uses",
        };
        let result = transfer_once(&mut session, written, settings, and_save, if_not_uploaded);
        let Err(error) = result else {
            return Ok(());
        };
        if !error.downcast_ref().is_some_and(LineError::may_pass) || tries == TRIES {
            return Err(error);
        }
        tries += 1;
        session = match session.reopen() {
            Ok(session) => session,
            // What the sensor uses now is what the first error says.
            Err(_) => return Err(error),
        };
    }
}

fn transfer_once(
    session: &mut Session<'_>,
    written: &EncodedRecord,
    settings: &[Value],
    and_save: bool,
    if_not_uploaded: &'static str,
) -> Result<()> {
    let uploaded = upload(session, written);
    if let Err(LineError::Refused { .. }) = uploaded {
        // The next upload drops this one all the same, should it fail.
        let _ = session.set(Command::Upload(Step::Abort));
    }
    uploaded.context(if_not_uploaded)?;
    commit(session, written)?;
    let back = record_in_use(session).context("uploaded, but not read back: write it again")?;
    ensure!(
        back.bytes() == written.bytes(),
        "what the sensor uses now is another record, CRC-32 {:08x}: write it again",
        back.sum()
    );
    for &value in settings {
        session.set(Command::Set(value))?;
    }
    if and_save {
        save(session, written)?;
    }
    Ok(())
}

/// Sends a record; nothing changes yet.
fn upload(session: &mut Session<'_>, written: &EncodedRecord) -> Result<(), LineError> {
    let bytes = written.bytes();
    // A record is at most some thousand bytes long.
    session.set(Command::Upload(Step::Begin(bytes.len() as u16)))?;
    for offset in (0..bytes.len()).step_by(PIECE) {
        if let Some(piece) = Piece::of(bytes, offset as u16) {
            session.set(Command::Upload(Step::Piece(piece)))?;
        }
    }
    Ok(())
}

/// Has the sensor use what was sent.
fn commit(session: &mut Session<'_>, written: &EncodedRecord) -> Result<()> {
    let Err(error) = session.set(Command::Upload(Step::Commit)) else {
        return Ok(());
    };
    // Where only the answer was lost, the sensor has no upload any more to commit once again.
    match session.calibration() {
        Ok(InUse {
            record: Some(now), ..
        }) if now.crc == written.sum() => Ok(()),
        Ok(_) => Err(error).context("nothing has changed, the sensor uses the calibration that it had"),
        Err(_) => Err(error).context(
            "the sensor uses the calibration that it had or the new one: `calibrate show` tells, with FILE \
             and --port",
        ),
    }
}

/// Has the sensor keep what is in use. One that started anew uses its flash, and is not asked to save.
fn save(session: &mut Session<'_>, written: &EncodedRecord) -> Result<()> {
    const UNKNOWN: &str = "uploaded; whether it is saved, `calibration` on the sensor's line tells";
    let question = Command::Save.to_string();
    let mut tries = 1;
    loop {
        let saved = (session.line()).ask_once(&question, SAVE, |it| is_echoed(it, &question));
        match saved {
            Ok(()) => {}
            Err(LineError::Silent { .. } | LineError::Refused { .. }) => {
                session.line().synchronise().context(UNKNOWN)?;
            }
            Err(_) => return saved.context(UNKNOWN),
        }
        let now = session.calibration().context(UNKNOWN)?;
        let crc = now.record.map(|record| record.crc);
        if crc != Some(written.sum()) {
            let banner = match crc {
                Some(crc) => format!("it uses another record, CRC-32 {crc:08x}"),
                None => "it has no calibration".to_owned(),
            };
            return Err(LineError::Restarted(banner)).context(UNKNOWN);
        }
        if now.stored == "same" {
            return Ok(());
        }
        if tries == TRIES {
            saved.context("it is in use, but not saved")?;
            bail!(
                "the sensor says that it saved, but not that its flash holds what it uses: it says `stored \
                 {}`",
                now.stored
            );
        }
        tries += 1;
    }
}

/// `calibrate read`.
pub fn read(options: &ReadOptions, pc: &dyn Pc, output: &mut dyn Write) -> Result<()> {
    let mut session = options.port.open(pc)?;
    let written = record_in_use(&mut session)?;
    writeln!(output, "{}", Shown::of(&written))?;
    if let Some(path) = &options.output {
        record_file::write(path, &written, options.force)?;
        writeln!(output, "\nwritten to {}", path.display())?;
    }
    Ok(())
}

pub(super) fn record_in_use(session: &mut Session<'_>) -> Result<EncodedRecord> {
    let in_use = session.calibration()?;
    let Some(record) = in_use.record else {
        bail!(
            "the sensor has no calibration (what it saved is {}): write one, or set `defaults`",
            in_use.stored
        );
    };
    let mut bytes = Vec::new();
    while bytes.len() < record.bytes {
        let offset = u16::try_from(bytes.len())?;
        let question = Command::Data(offset).to_string();
        let piece = session.line().ask(&question, ANSWER, |lines| {
            match parse(lines.last()?.as_bytes()) {
                Ok(Command::Upload(Step::Piece(piece))) if piece.offset() == offset => Some(piece),
                _ => None,
            }
        })?;
        bytes.extend_from_slice(piece.bytes());
    }
    let written = decode(&bytes).and_then(EncodedRecord::new);
    let written = written.context("what the sensor sent is no record")?;
    ensure!(
        written.sum() == record.crc,
        "what the sensor sent is another record, CRC-32 {:08x}, than it said, {:08x}: somebody changed it \
         meanwhile, read it again",
        written.sum(),
        record.crc
    );
    Ok(written)
}

/// `calibrate show`. The exit code tells whether two records are the same.
pub fn show(options: &ShowOptions, pc: &dyn Pc, output: &mut dyn Write) -> Result<ExitCode> {
    let records = options.files.iter().map(|path| record_file::read(path));
    let mut records: Vec<EncodedRecord> = records.collect::<Result<_>>()?;
    if let Some(port) = &options.port {
        records.push(record_in_use(&mut Session::open(pc, port)?)?);
    }
    let (shown, same) = match records.as_slice() {
        [record] => (text(&Shown::of(record), options.json)?, true),
        [first, second] => {
            let comparison = Comparison::of(first, second);
            (text(&comparison, options.json)?, comparison.same)
        }
        _ => bail!(
            "there are {} records: show one, or compare two",
            records.len()
        ),
    };
    writeln!(output, "{shown}")?;
    Ok(ExitCode::from(u8::from(!same)))
}

/// For a person, or for a program.
fn text(shown: &(impl Display + Serialize), is_json: bool) -> Result<String> {
    match is_json {
        true => Ok(serde_json::to_string_pretty(shown)?),
        false => Ok(shown.to_string()),
    }
}
