//! `record`: whole rows into a file.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use slitrange::light::ambient::AmbientMode;
use slitrange_device::protocol::packet::Decoder;
use slitrange_device::settings::serial_line::{Baud, PixelStream};
use slitrange_device::settings::trigger::Trigger;
use slitrange_device::settings::{Setting, Value};

use super::answers;
use super::line::ANSWER;
use super::port::PortOption;
use super::session::Session;
use super::transfer::record_in_use;
use crate::pc::Pc;
use crate::recording::{Row, Rows, Sensor, Writer};
use crate::whole_file::cannot_be_made;

/// The sensor has stopped after so long. A row takes 66 ms; an emulated board can be slower than the clock.
const PATIENCE: Duration = Duration::from_secs(10);
/// After so much time without a packet, the command for packets is sent again.
const AGAIN: Duration = Duration::from_secs(1);
/// How long to wait for bytes before Ctrl-C is looked for.
const TICK: Duration = Duration::from_millis(100);
/// So often a line says how many rows came.
const PROGRESS: Duration = Duration::from_secs(2);

/// Record whole rows, for `slitrange replay`
///
/// The sensor sends rows as fast as the line takes them, about 15 a second at 921600 baud, each with its own
/// result. The file holds the rows, the results, the settings and the calibration. The sensor is recorded
/// with `ambient off`, `flat off` and `trigger continuous`, and has its own settings again afterwards. Ctrl-C
/// ends the recording.
#[derive(Clone, Debug, clap::Args)]
pub struct RecordOptions {
    #[command(flatten)]
    port: PortOption,
    /// How many rows
    #[arg(long, default_value_t = 100)]
    rows: u32,
    /// Bits a second on the line while rows are recorded
    #[arg(long, default_value = "921600", value_parser = baud)]
    baud: Baud,
    /// The file to write
    file: PathBuf,
}

/// Reads a rate that the sensor has.
fn baud(word: &str) -> Result<Baud> {
    let rates = Baud::ALL.map(|baud| baud.bits_a_second());
    let rate = word.parse::<u32>().ok();
    let is_rate = |it: &Baud| Some(it.bits_a_second()) == rate;
    let baud = Baud::ALL.into_iter().find(is_rate);
    baud.with_context(|| format!("the sensor has the rates {rates:?}"))
}

/// `record`.
///
/// # Errors
/// In sentences. The rows that came before are in the file.
pub fn record(options: &RecordOptions, pc: &dyn Pc, output: &mut dyn Write) -> Result<()> {
    ensure!(options.rows > 0, "--rows 0: there is nothing to record");
    // From now on, Ctrl-C ends the recording in order.
    pc.interrupted();
    let mut session = options.port.open(pc)?;
    writeln!(output, "sensor {} at {}", session.head(), session.port())?;
    let name = options.file.display();
    let file =
        File::create_new(&options.file).map_err(|error| cannot_be_made(&options.file, error))?;
    // A row is recorded as it was read, and both would need rows or a map that the file does not have.
    session.borrow_without_map()?;
    session.borrow(Value::Ambient(AmbientMode::Off))?;
    // Rows come only if frames need no trigger.
    session.borrow(Value::Trigger(Trigger::Continuous))?;
    let sensor = sensor(&mut session)?;
    let mut file = BufWriter::new(file);
    let mut writer = Writer::default();
    file.write_all(&writer.head(&sensor))?;
    let write = |row: &Row| Ok(file.write_all(&writer.row(row))?);
    let recorded = take_rows(&mut session, options.baud, options.rows, write, output);
    file.flush()?;
    // The sensor has its own settings again before anything is said.
    drop(session);
    let (rows, skipped) = recorded?;
    if rows < options.rows {
        write!(output, "ended by Ctrl-C: ")?;
    }
    writeln!(
        output,
        "{rows} rows written to {name}; the line was too slow for {skipped} rows between them"
    )?;
    Ok(())
}

/// What the measurement of the rows needs.
fn sensor(session: &mut Session<'_>) -> Result<Sensor> {
    let record = record_in_use(session)?;
    let settings = session.settings(Setting::ALL)?;
    let lines = session.line().ask("calibration", ANSWER, |lines| {
        answers::in_use(lines).map(|_| lines.to_vec())
    })?;
    Ok(Sensor {
        head: session.head().to_owned(),
        settings,
        record,
        is_calibration_on: !lines.iter().any(|line| line == "calibration off"),
    })
}

/// Takes rows until there are enough, or Ctrl-C. Gives their number, and how many rows came between them.
fn take_rows(
    session: &mut Session<'_>,
    baud: Baud,
    wanted: u32,
    mut write: impl FnMut(&Row) -> Result<()>,
    output: &mut dyn Write,
) -> Result<(u32, u64)> {
    session.borrow(Value::Pixels(PixelStream::Rows))?;
    session.stream()?;
    session.send_packets(baud)?;
    let pc = session.line().pc();
    let (mut decoder, mut rows) = (Decoder::new(), Rows::default());
    let (mut count, mut between, mut before) = (0, 0, None::<u32>);
    let mut until = pc.now() + PATIENCE;
    let mut progress = pc.now() + PROGRESS;
    let mut again = Some(pc.now() + AGAIN);
    let mut bytes = [0; 4096];
    loop {
        let got = session.line().bytes(&mut bytes, TICK)?;
        if pc.interrupted() {
            return Ok((count, between));
        }
        ensure!(
            pc.now() < until,
            "no whole row came for {} s: {count} of {wanted} rows are in the file. Try a lower --baud, or \
             check the cable",
            PATIENCE.as_secs()
        );
        if again.is_some_and(|again| pc.now() >= again) {
            session.ask_for_packets()?;
            again = Some(pc.now() + AGAIN);
        }
        for &byte in bytes.iter().take(got) {
            // A damaged packet costs its row, and the number of the next row shows it.
            let Some(Ok(packet)) = decoder.take(byte) else {
                continue;
            };
            again = None;
            let Some(row) = rows.take(packet.message) else {
                continue;
            };
            write(&row)?;
            count += 1;
            if let Some(before) = before {
                between += u64::from(row.head.number.wrapping_sub(before).saturating_sub(1));
            }
            before = Some(row.head.number);
            until = pc.now() + PATIENCE;
            if count == wanted {
                return Ok((count, between));
            }
            if pc.now() >= progress {
                progress = pc.now() + PROGRESS;
                writeln!(output, "{count} of {wanted} rows")?;
            }
        }
    }
}
