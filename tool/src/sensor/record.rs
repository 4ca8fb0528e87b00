//! `record`: whole rows into a file.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use slitrange::ambient::AmbientMode;
use slitrange::protocol::command::Command;
use slitrange::protocol::flat::Flat;
use slitrange::protocol::packet::Decoder;
use slitrange::sending::{Baud, Format, PixelStream};
use slitrange::settings::{Setting, Settings, Value};
use slitrange::trigger::Trigger;

use super::answers;
use super::line::ANSWER;
use super::port::PortOption;
use super::session::Session;
use super::transfer::record_in_use;
use crate::pc::Pc;
use crate::recording::{Rows, Sensor, Writer};

/// Without a row for so long, the sensor has stopped. A row takes 66 ms; an emulated board can be slower than
/// the clock on the wall.
const PATIENCE: Duration = Duration::from_secs(10);

/// Record whole rows, for `slitrange replay`
///
/// The sensor sends rows as fast as the line takes them, about 15 a second at 921600 baud, each with its own
/// result. The file holds the rows, the results, the settings and the calibration. The sensor is recorded
/// with `ambient off`, `flat off` and `trigger continuous`, and has its own settings again afterwards.
#[derive(Clone, Debug, clap::Args)]
pub struct RecordOptions {
    #[command(flatten)]
    #[expect(missing_docs, reason = "its help is that of its options")]
    pub port: PortOption,
    /// How many rows
    #[arg(long, default_value_t = 100)]
    pub rows: u32,
    /// Bits a second on the line while rows are recorded
    #[arg(long, default_value_t = 921_600, value_parser = baud)]
    pub baud: u32,
    /// The file to write
    pub file: PathBuf,
}

/// Reads a rate that the sensor has.
fn baud(word: &str) -> Result<u32> {
    let rates = Baud::ALL.map(|baud| baud.bits_a_second());
    let rate = word.parse().ok().filter(|rate| rates.contains(rate));
    rate.with_context(|| format!("the sensor has the rates {rates:?}"))
}

/// `record`.
///
/// # Errors
/// In sentences. The rows that came before are in the file.
pub fn record(options: &RecordOptions, pc: &dyn Pc, output: &mut dyn Write) -> Result<()> {
    ensure!(options.rows > 0, "--rows 0: there is nothing to record");
    let mut session = options.port.open(pc)?;
    let name = options.file.display();
    let file = File::create_new(&options.file)
        .with_context(|| format!("{name} cannot be written as a new file"))?;
    let flat = Flat::Use(false).to_string();
    let has_map = (session.line()).ask("flat", ANSWER, answers::flat)?;
    let is_map_on = has_map.first().is_some_and(|line| line == "flat on");
    let ambient = session.value(Setting::Ambient)?;
    let trigger = session.value(Setting::Trigger)?;
    // A row is recorded as it was read, and both would need rows or a map that the file does not have.
    if is_map_on {
        (session.line()).ask(&flat, ANSWER, |lines| {
            (lines.last()? == &flat).then_some(())
        })?;
    }
    session.set(Command::Set(Value::Ambient(AmbientMode::Off)))?;
    // Rows come only if frames need no trigger.
    session.set(Command::Set(Value::Trigger(Trigger::Continuous)))?;
    let sensor = sensor(&mut session)?;
    let mut file = BufWriter::new(file);
    let mut writer = Writer::default();
    file.write_all(&writer.head(&sensor))?;
    let found = Baud::ALL
        .into_iter()
        .find(|it| it.bits_a_second() == options.baud);
    let recorded = take_rows(
        &mut session,
        found.unwrap_or_default(),
        options.rows,
        |row| Ok(file.write_all(&writer.row(row))?),
        output,
    );
    session.line().wake()?;
    session.line().synchronise()?;
    session.set(Command::Set(Value::Pixels(PixelStream::None)))?;
    session.set(Command::Set(Value::Stream(false)))?;
    session.set(Command::Set(trigger))?;
    session.set(Command::Set(ambient))?;
    if is_map_on {
        let on = Flat::Use(true).to_string();
        (session.line()).ask(&on, ANSWER, |lines| (lines.last()? == &on).then_some(()))?;
    }
    file.flush()?;
    let (rows, skipped) = recorded?;
    writeln!(
        output,
        "{rows} rows written to {name}; the line was too slow for {skipped} rows between them"
    )?;
    Ok(())
}

/// What the measurement of the rows needs.
fn sensor(session: &mut Session<'_>) -> Result<Sensor> {
    let record = record_in_use(session)?;
    let mut settings = Settings::default();
    for &setting in Setting::ALL {
        settings.set(session.value(setting)?);
    }
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

/// Takes rows until there are enough. Gives their number, and how many rows the sensor read between them.
fn take_rows(
    session: &mut Session<'_>,
    baud: Baud,
    wanted: u32,
    mut write: impl FnMut(&crate::recording::Row) -> Result<()>,
    output: &mut dyn Write,
) -> Result<(u32, u64)> {
    session.set(Command::Set(Value::Pixels(PixelStream::Rows)))?;
    session.set(Command::Set(Value::Stream(true)))?;
    session.set(Command::Set(Value::Baud(baud)))?;
    let line = session.line();
    line.set_baud(baud)?;
    let binary = Command::Set(Value::Format(Format::Binary)).to_string();
    line.tell(&binary)?;
    let pc = line.pc();
    let (mut decoder, mut rows) = (Decoder::new(), Rows::default());
    let (mut count, mut between, mut before) = (0, 0, None::<u32>);
    let mut until = pc.now() + PATIENCE;
    let mut bytes = [0; 4096];
    loop {
        let got = line.bytes(&mut bytes, until.saturating_sub(pc.now()))?;
        ensure!(
            pc.now() < until,
            "no whole row came for {} s: {count} of {wanted} rows are in the file. Try a lower --baud, or \
             check the cable",
            PATIENCE.as_secs()
        );
        for &byte in bytes.iter().take(got) {
            // A damaged packet costs its row, and the number of the next row shows it.
            let Some(Ok(packet)) = decoder.take(byte) else {
                continue;
            };
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
            if count % 100 == 0 {
                writeln!(output, "{count} of {wanted} rows")?;
            }
        }
    }
}
