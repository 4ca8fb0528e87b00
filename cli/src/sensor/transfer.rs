//! Records between sensors and files.

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use slitrange::calibration::record::decode;
use slitrange::calibration::written::Written;
use slitrange::protocol::command::{Command, parse};
use slitrange::protocol::piece::{PIECE, Piece};
use slitrange::protocol::upload::Step;

use super::answers::RecordInUse;
use super::line::{LineError, Waits};
use super::session::Session;
use crate::record_file::{self, Comparison, Shown};

/// How often an upload begins anew, if the sensor goes away in it, and how often the flash is asked to keep it.
const TRIES: usize = 3;

/// Write a record to the sensor: upload it, read it back, compare, and save it
///
/// FILE is what `calibrate fit` or `calibrate read` wrote. The sensor uses the record when all of it has come and is sound, or goes on
/// with the one it had. Its estimator and black level are set as when it was calibrated. `save` keeps them over a power cycle,
/// and with them the rows in a frame and their mean, as they are set.
#[derive(Clone, Debug, clap::Args)]
pub struct WriteOptions {
    /// The record
    pub file: PathBuf,
    /// The sensor's serial port, such as /dev/ttyACM0 or COM3
    #[arg(long)]
    pub port: String,
    /// Leave the flash as it is: the record is used until the power goes
    #[arg(long)]
    pub no_save: bool,
}

/// Read the record that the sensor uses, show it, and write it to a file
#[derive(Clone, Debug, clap::Args)]
pub struct ReadOptions {
    /// The sensor's serial port, such as /dev/ttyACM0 or COM3
    #[arg(long)]
    pub port: String,
    /// The file to write
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}

/// Show a record, of a file or of a sensor, or how two of them differ
///
/// With two files, or a file and a port: what they say otherwise than each other, and by how much their distances differ. The exit
/// code is then 0 if they are the same bit for bit, 1 if not.
#[derive(Clone, Debug, clap::Args)]
#[command(override_usage = "\
slitrange calibrate show FILE
       slitrange calibrate show --port PORT
       slitrange calibrate show FILE FILE
       slitrange calibrate show FILE --port PORT")]
pub struct ShowOptions {
    /// Records
    #[arg(value_name = "FILE", num_args = 0..=2, required_unless_present = "port")]
    pub files: Vec<PathBuf>,
    /// A sensor's serial port: the record that it uses
    #[arg(long)]
    pub port: Option<String>,
    /// For programs
    #[arg(long)]
    pub json: bool,
}

/// `calibrate write`.
///
/// # Errors
/// In sentences: the sensor uses the record that it had, or the new one, as is said.
pub fn write(options: &WriteOptions) -> Result<()> {
    write_with(options, Waits::default(), &mut io::stdout())
}

/// The same with other times to wait.
///
/// # Errors
/// As [`write()`].
pub fn write_with(options: &WriteOptions, waits: Waits, output: &mut dyn Write) -> Result<()> {
    let written = record_file::read(&options.file)?;
    let record = written.record();
    let mut session = Session::open(&options.port, waits)?;
    let before = session.calibration()?.record;
    writeln!(
        output,
        "record of sensor {}, {}, {} bytes, CRC-32 {:08x}, for the sensor {} at {}",
        record.serial_number,
        record.date,
        written.bytes().len(),
        written.sum(),
        session.head(),
        options.port
    )?;
    if let Some(RecordInUse { serial_number, .. }) = before
        && serial_number != 0
        && serial_number != record.serial_number
    {
        writeln!(
            output,
            "mind: the sensor's calibration until now was that of sensor {serial_number}"
        )?;
    }
    let mut session = upload(session, &written)
        .context("nothing has changed, the sensor uses the calibration that it had")?;
    let back = record_in_use(&mut session)?;
    ensure!(
        back.bytes() == written.bytes(),
        "what the sensor uses now is another record, CRC-32 {:08x}: write it again",
        back.sum()
    );
    writeln!(
        output,
        "uploaded and in use; read back, it is the same bit for bit. Set with it: estimator {}, {}",
        record.estimator.name(),
        Command::Black(Some(record.black_level))
    )?;
    if options.no_save {
        writeln!(output, "not saved: it is used until the power goes")?;
        return Ok(());
    }
    save(&mut session, &written).context("it is in use, but not saved")?;
    writeln!(output, "saved: it is kept over a power cycle")?;
    Ok(())
}

/// Sends a record and has the sensor use it; again from the beginning if the sensor goes away meanwhile.
fn upload(mut session: Session, written: &Written) -> Result<Session> {
    let mut tries = 1;
    loop {
        match send(&mut session, written) {
            Ok(()) => return Ok(session),
            Err(error) if error.may_pass() && tries < TRIES => {
                tries += 1;
                session = session.reopen()?;
            }
            Err(error) => {
                // Whether that succeeds does not matter: the next upload drops this one, too.
                let _ = session.set(Command::Upload(Step::Abort));
                return Err(error.into());
            }
        }
    }
}

fn send(session: &mut Session, written: &Written) -> Result<(), LineError> {
    let bytes = written.bytes();
    // A record is at most some thousand bytes long.
    session.set(Command::Upload(Step::Begin(bytes.len() as u16)))?;
    for offset in (0..bytes.len()).step_by(PIECE) {
        if let Some(piece) = Piece::of(bytes, offset as u16) {
            session.set(Command::Upload(Step::Piece(piece)))?;
        }
    }
    let committed = session.set(Command::Upload(Step::Commit));
    if committed.is_ok() {
        return committed;
    }
    // Where only the answer was lost, the sensor has no upload any more to commit once again.
    match session.calibration()?.record {
        Some(now) if now.crc == written.sum() => Ok(()),
        _ => committed,
    }
}

/// Has the sensor keep what is in use.
fn save(session: &mut Session, written: &Written) -> Result<()> {
    let wait = session.line().waits.save;
    let question = Command::Save.to_string();
    for tries in 1.. {
        let saved = session.line().ask_once(&question, wait, |lines| {
            (*lines.last()? == question).then_some(())
        });
        if let Err(LineError::Silent { .. } | LineError::Refused { .. }) = saved {
            session.line().synchronise()?;
        }
        let now = session.calibration()?;
        let same = now.record.is_some_and(|record| record.crc == written.sum());
        if same && now.stored == "same" {
            break;
        }
        if tries == TRIES {
            saved?;
            bail!(
                "the sensor says that it saved, and then that its flash holds another record (`calibration`)"
            );
        }
    }
    Ok(())
}

/// `calibrate read`.
///
/// # Errors
/// In sentences.
pub fn read(options: &ReadOptions) -> Result<()> {
    read_with(options, Waits::default(), &mut io::stdout())
}

/// The same with other times to wait.
///
/// # Errors
/// As [`read()`].
pub fn read_with(options: &ReadOptions, waits: Waits, output: &mut dyn Write) -> Result<()> {
    let mut session = Session::open(&options.port, waits)?;
    let written = record_in_use(&mut session)?;
    writeln!(output, "{}", Shown::of(&written))?;
    if let Some(path) = &options.output {
        record_file::write(path, &written)?;
        writeln!(output, "\nwritten to {}", path.display())?;
    }
    Ok(())
}

/// The record that a sensor uses.
fn record_in_use(session: &mut Session) -> Result<Written> {
    let wait = session.line().waits.answer;
    let in_use = session.calibration()?;
    let Some(RecordInUse {
        bytes: length, crc, ..
    }) = in_use.record
    else {
        bail!(
            "the sensor has no calibration (what it saved is {}): write one, or set `defaults`",
            in_use.stored
        );
    };
    let mut bytes = Vec::new();
    while bytes.len() < length {
        let offset = u16::try_from(bytes.len())?;
        let question = Command::Data(offset).to_string();
        let piece = session.line().ask(&question, wait, |lines| {
            match parse(lines.last()?.as_bytes()) {
                Ok(Command::Upload(Step::Piece(piece))) if piece.offset() == offset => Some(piece),
                _ => None,
            }
        })?;
        bytes.extend_from_slice(piece.bytes());
    }
    let written = decode(&bytes)
        .and_then(Written::new)
        .context("what the sensor sent is no record")?;
    ensure!(
        written.sum() == crc,
        "what the sensor sent is another record, CRC-32 {:08x}, than it said, {crc:08x}: somebody changed it meanwhile, read it again",
        written.sum()
    );
    Ok(written)
}

/// `calibrate show`. The exit code tells whether two records are the same.
///
/// # Errors
/// In sentences.
pub fn show(options: &ShowOptions) -> Result<ExitCode> {
    show_with(options, Waits::default(), &mut io::stdout())
}

/// The same with other times to wait.
///
/// # Errors
/// As [`show`].
pub fn show_with(options: &ShowOptions, waits: Waits, output: &mut dyn Write) -> Result<ExitCode> {
    let mut records = Vec::new();
    for path in &options.files {
        records.push(record_file::read(path)?);
    }
    if let Some(port) = &options.port {
        records.push(record_in_use(&mut Session::open(port, waits)?)?);
    }
    match records.as_slice() {
        [record] => {
            let shown = Shown::of(record);
            if options.json {
                writeln!(output, "{}", serde_json::to_string_pretty(&shown)?)?;
            } else {
                writeln!(output, "{shown}")?;
            }
            Ok(ExitCode::SUCCESS)
        }
        [first, second] => {
            let comparison = Comparison::of(first, second);
            if options.json {
                writeln!(output, "{}", serde_json::to_string_pretty(&comparison)?)?;
            } else {
                writeln!(output, "{comparison}")?;
            }
            Ok(if comparison.same {
                ExitCode::SUCCESS
            } else {
                ExitCode::FAILURE
            })
        }
        _ => bail!(
            "there are {} records: show one, or compare two",
            records.len()
        ),
    }
}
