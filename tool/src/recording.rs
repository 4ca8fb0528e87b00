//! A recording: rows as the sensor sent them, in a file that has all that their measurement needs.
//!
//! The file is packets of the serial line (`slitrange_device::protocol::packet`). The first ones are text, in
//! these lines:
//!
//! ```text
//! slitrange recording 1
//! head TCD1304DG
//! rows 16
//! black shielded
//! record 01...
//! calibration on
//! ```
//!
//! Each setting has the line that sets it, and `record` has the sensor's record in hexadecimal. Then follow
//! the rows with their words, and the sensor's own result of each row.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufRead as _, BufReader, Read};
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use slitrange::base::units::Units;
use slitrange_device::protocol::command::{Command, parse, parse_in};
use slitrange_device::protocol::packet::{
    Decoder, Message, Packets, RowHead, RowWords, parts_of_text, unpack,
};
use slitrange_device::record::{self, encoded::EncodedRecord};
use slitrange_device::settings::{Settings, Value};

/// The first line of every recording: these words, and the version of the format.
const FIRST_WORDS: &str = "slitrange recording";
const VERSION: u32 = 1;
/// The most bytes of text before the rows. The longest record takes 5 kB of it, and the settings less.
const MAX_TEXT: usize = 65_536;

/// What the measurement of the rows needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// The sensor head's name.
    pub head: String,
    /// The settings.
    pub settings: Settings,
    /// The calibration.
    pub record: EncodedRecord,
    /// Whether the sensor gave distances.
    pub is_calibration_on: bool,
}

/// A row: its words, and what the sensor says of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The sensor's number, time, exposure and result.
    pub head: RowHead,
    /// The words of the read-out.
    pub words: Vec<u16>,
}

/// Puts rows together from packets.
#[derive(Debug, Default)]
pub struct Rows {
    under_way: Option<Row>,
}

impl Rows {
    /// Takes the next packet, and gives the row that is whole with it. A row without words, which did not
    /// come from the sensor, is none. A row of which a packet is missing is none either.
    pub fn take(&mut self, message: Message<'_>) -> Option<Row> {
        match message {
            Message::Row(head) => {
                let words = vec![];
                self.under_way = Some(Row { head, words });
                return None;
            }
            Message::Words {
                number,
                first,
                words,
            } => {
                let row = self.under_way.as_mut()?;
                if number != row.head.number || usize::from(first) != row.words.len() {
                    self.under_way = None;
                    return None;
                }
                row.words.extend(unpack(words));
            }
            Message::Text(_) | Message::Result(_) | Message::Window { .. } => {}
        }
        let is_whole = |row: &mut Row| row.words.len() == usize::from(row.head.words);
        let is_row = |row: &Row| !row.words.is_empty();
        self.under_way.take_if(is_whole).filter(is_row)
    }
}

/// Writes a recording's packets, one after the other.
#[derive(Debug, Default)]
pub struct Writer(Packets);

impl Writer {
    /// The first bytes of the file.
    pub fn head(&mut self, sensor: &Sensor) -> Vec<u8> {
        let mut text = format!("{FIRST_WORDS} {VERSION}\r\nhead {}\r\n", sensor.head);
        for &setting in slitrange_device::settings::Setting::ALL {
            // Writing to a String cannot fail.
            let _ = write!(text, "{}\r\n", sensor.settings.get(setting).stored());
        }
        text += "record ";
        for byte in sensor.record.bytes() {
            let _ = write!(text, "{byte:02x}");
        }
        let on = Command::Calibration(Some(sensor.is_calibration_on));
        let _ = write!(text, "\r\n{on}\r\n");
        let mut bytes = vec![];
        for part in parts_of_text(&text) {
            bytes.extend_from_slice(self.0.encode(Message::Text(part)));
        }
        bytes
    }

    /// The bytes of a row.
    pub fn row(&mut self, row: &Row) -> Vec<u8> {
        let mut bytes = self.0.encode(Message::Row(row.head)).to_vec();
        let mut words = RowWords::new(row.head.number, &row.words);
        while let Some(message) = words.next_message() {
            bytes.extend_from_slice(self.0.encode(message));
        }
        bytes
    }
}

/// Reads a recording row by row, with the memory of a row, however long the file is.
#[derive(Debug)]
pub struct Reader<R> {
    bytes: io::Bytes<BufReader<R>>,
    decoder: Decoder,
    rows: Rows,
    /// What the measurement of the rows needs.
    pub sensor: Sensor,
    /// The damaged packets so far. Their rows are missing.
    pub damaged: u64,
}

/// Opens a recording.
pub fn open(path: &Path) -> Result<Reader<File>> {
    let file = File::open(path).with_context(|| format!("{} cannot be read", path.display()))?;
    Reader::new(file).with_context(|| path.display().to_string())
}

impl<R: Read> Reader<R> {
    /// Reads what a recording begins with: the text before the rows.
    ///
    /// # Errors
    /// The bytes cannot be read, or are no recording. A damaged packet ends the text, so what it had is
    /// missing.
    pub fn new(file: R) -> Result<Self> {
        let mut file = BufReader::new(file);
        let is_empty = file.fill_buf()?.is_empty();
        ensure!(
            !is_empty,
            "it is empty: take a recording with `slitrange record`"
        );
        let mut bytes = file.bytes();
        let (mut decoder, mut rows) = (Decoder::new(), Rows::default());
        let (mut text, mut damaged) = (Vec::new(), 0);
        for byte in &mut bytes {
            match decoder.take(byte?) {
                Some(Ok(packet)) => match packet.message {
                    Message::Text(part) if text.len() < MAX_TEXT => text.extend_from_slice(part),
                    message => {
                        // The head of a row, which cannot be whole yet.
                        rows.take(message);
                        break;
                    }
                },
                Some(Err(_)) => {
                    damaged += 1;
                    break;
                }
                None => {}
            }
        }
        Ok(Self {
            sensor: sensor(&String::from_utf8_lossy(&text))?,
            bytes,
            decoder,
            rows,
            damaged,
        })
    }
}

impl<R: Read> Iterator for Reader<R> {
    type Item = io::Result<Row>;

    fn next(&mut self) -> Option<io::Result<Row>> {
        for byte in &mut self.bytes {
            let byte = match byte {
                Ok(byte) => byte,
                Err(error) => return Some(Err(error)),
            };
            match self.decoder.take(byte) {
                Some(Ok(packet)) => {
                    if let Some(row) = self.rows.take(packet.message) {
                        return Some(Ok(row));
                    }
                }
                Some(Err(_)) => self.damaged += 1,
                None => {}
            }
        }
        None
    }
}

/// Reads the lines before the rows. Unknown settings are left out: rows of newer firmware can be measured.
fn sensor(text: &str) -> Result<Sensor> {
    let mut lines = text.lines();
    let first = lines.next().unwrap_or_default();
    let version: Option<u32> =
        (first.strip_prefix(FIRST_WORDS)).and_then(|it| it.trim().parse().ok());
    let version = version.with_context(|| {
        format!(
            "this is no recording: it begins with {first:?}, and not with `{FIRST_WORDS} {VERSION}`"
        )
    })?;
    ensure!(
        version == VERSION,
        "the recording has version {version}, this tool reads {VERSION}: update the tool"
    );
    let (mut head, mut written, mut on) = (None, None, None);
    let mut settings = Settings::default();
    for line in lines {
        if let Some(name) = line.strip_prefix("head ") {
            head = Some(name.to_owned());
        } else if let Some(digits) = line.strip_prefix("record ") {
            written = Some(record_of(digits)?);
        } else {
            match parse_in(Units::Micrometres, line.as_bytes()) {
                Ok(Command::Set(value)) => settings.set(value),
                Ok(Command::Calibration(Some(is_on))) => on = Some(is_on),
                _ => {}
            }
        }
    }
    match (head, written, on) {
        (Some(head), Some(record), Some(is_calibration_on)) => Ok(Sensor {
            head,
            settings,
            record,
            is_calibration_on,
        }),
        _ => bail!("the sensor head, its record or `calibration on|off` is missing"),
    }
}

fn record_of(digits: &str) -> Result<EncodedRecord> {
    let bytes: Option<Vec<u8>> = (digits.as_bytes().chunks(2))
        .map(|two| u8::from_str_radix(std::str::from_utf8(two).ok()?, 16).ok())
        .collect();
    record::decode(&bytes.context("the record is not in hexadecimal")?)
        .and_then(EncodedRecord::new)
        .context("the sensor's record is damaged")
}

/// Reads a setting as a person types it.
pub fn setting(text: &str) -> Result<Value> {
    match parse(text.as_bytes()) {
        Ok(Command::Set(value)) => Ok(value),
        Ok(_) => bail!("`{text}` is no setting with a value, such as `estimator centroid`"),
        Err(error) => bail!("`{text}`: {error}"),
    }
}
