//! A sensor's Modbus registers on standard input and output, to try a master with. The result is a made-up
//! reading, or the fault `laser off`. Standard error has the line of each result.
//!
//!     cargo run --package slitrange-device --example modbus_server

use std::io::{self, Read as _, Write as _};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use slitrange::spot::region::Region;
use slitrange::{
    Calibration, CalibrationErrors, Fault, Measurement, Reading, Surface, sensor_heads,
};
use slitrange_device::Settings;
use slitrange_device::protocol::line::{FaultLine, ReadingLine};
use slitrange_device::protocol::modbus::{self, Shown};

const STATION: u8 = 17;

/// The silence that ends a request. On a serial line of 115200 baud it is 1.75 ms (Modbus over serial line
/// V1.02, section 2.5.1.1); a PC can stop a program for longer.
const SILENCE: Duration = Duration::from_millis(20);

/// A reading of a row with a spot of 2000 counts on pixel 1800.
fn reading(settings: Settings) -> Result<Reading, Fault> {
    let head = sensor_heads::tcd1304dg();
    let spot = |i: usize| {
        let u = (i as f64 - head.light.start as f64 - 1800.0) / 9.0;
        2000.0 * (-0.5 * u * u).exp() + (i * 7 % 5 / 2) as f64
    };
    let words: Vec<u16> = (0..head.words).map(|i| (3800.0 - spot(i)) as u16).collect();
    let mut measurement = Measurement::new(head, settings.options());
    let measured = (0..settings.rows).find_map(|_| measurement.row(&mut words.clone()));
    let nominal = Calibration::nominal();
    let errors = CalibrationErrors::Nominal;
    let measured = measured.unwrap_or(Err(Fault::SensorSilent))?;
    measured.reading(nominal.as_ref(), &errors, Surface::Auto)
}

fn say(result: &Result<Reading, Fault>) {
    match result {
        Ok(reading) => eprintln!("{}", ReadingLine(reading)),
        Err(fault) => eprintln!("{}", FaultLine(fault, Region::ALL)),
    }
}

fn main() -> io::Result<()> {
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || {
        let mut bytes = [0; modbus::MAX_BYTES];
        while let Ok(count @ 1..) = io::stdin().read(&mut bytes) {
            if sender.send(bytes[..count].to_vec()).is_err() {
                return;
            }
        }
    });
    let mut settings = Settings::default();
    let mut result = reading(settings);
    say(&result);
    // Of requests: there is one result for each change of a setting.
    let mut counter = 0;
    let mut request = vec![];
    loop {
        match receiver.recv_timeout(SILENCE) {
            Ok(bytes) => request.extend(bytes),
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
            Err(RecvTimeoutError::Timeout) if request.is_empty() => {}
            Err(RecvTimeoutError::Timeout) => {
                counter += 1;
                let shown = Shown {
                    inputs: &modbus::inputs(Some(&result), counter),
                    settings: &settings,
                    is_relative: false,
                    can_save: false,
                };
                let answer = modbus::answer(&request, STATION, &shown);
                for &change in &answer.changes {
                    settings.set(change);
                    result = reading(settings);
                    say(&result);
                }
                io::stdout().write_all(&answer.bytes)?;
                io::stdout().flush()?;
                request.clear();
            }
        }
    }
}
