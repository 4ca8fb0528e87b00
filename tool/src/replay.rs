//! `replay`: the rows of a recording once more through the core, on the PC.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use slitrange::frame::comb::Comb;
use slitrange::{Fault, Measured, Measurement, Reading, sensor_heads};
use slitrange_device::filters::average::Average;
use slitrange_device::protocol::command::Command;
use slitrange_device::protocol::info::{BrownOut, Clock, Hardware};
use slitrange_device::protocol::status::{StartCause, Vitals};
use slitrange_device::session::{Actions, Event, Session};
use slitrange_device::settings::Value;
use slitrange_device::settings::serial_line::{Format, PixelStream};
use slitrange_device::store::{Stored, configuration::Configuration};
use statistics::Moments;

use crate::recording::{self, Row, Sensor};
use crate::whole_file::NewFile;

/// Measure the rows of a recording once more, with the sensor's settings or others
///
/// With the sensor's own settings, each row must give the bits that the sensor reported: the exit code is 1
/// if one does not. With `--set` it shows what other settings make of the same rows.
#[derive(Clone, Debug, clap::Args)]
pub struct ReplayOptions {
    /// A file that `slitrange record` wrote
    file: PathBuf,
    /// Another setting, as it is typed at the sensor: --set "estimator centroid"
    #[arg(long, value_name = "SETTING", value_parser = recording::setting)]
    set: Vec<Value>,
    /// Write a table: a line for each row, with its distance, u and centre, or its fault
    #[arg(long)]
    csv: Option<PathBuf>,
}

/// The core on the PC, with the settings and the record of a sensor.
#[derive(Debug)]
pub struct Core {
    measurement: Measurement,
    session: Session,
    actions: Actions,
}

impl Core {
    /// The core as the sensor had it, with some settings changed.
    pub fn new(sensor: &Sensor, changes: &[Value]) -> Result<Self> {
        let geometry = sensor_heads::tcd1304dg();
        let record = sensor.record.record().clone();
        ensure!(
            record.geometry.is_compatible_with(&geometry),
            "the rows are of the sensor head {}, which this program does not know",
            sensor.head
        );
        let hardware = Hardware {
            board: "PC",
            head: "",
            row_us: 0,
            longest_exposure: slitrange::base::exposure::Exposure::LONGEST,
            clock: Clock::External,
            brown_out: BrownOut::Off,
            last_stop: None,
        };
        let mut settings = sensor.settings;
        for &value in changes {
            settings.set(value);
        }
        // Each row is a result of its own.
        (settings.rate, settings.hold, settings.average) = (0, 0, Average::None);
        (settings.stream, settings.format) = (true, Format::Binary);
        (settings.plain, settings.address) = (false, 0);
        settings.pixels = PixelStream::None;
        let mut core = Self {
            measurement: Measurement::new(geometry.clone(), settings.options()),
            session: Session::new(hardware, geometry, StartCause::PowerOn),
            actions: Actions::default(),
        };
        let stored = Stored::Newest(Configuration {
            settings,
            record: (!record.is_of_factory()).then_some(record),
        });
        core.session.start(&stored, &mut core.actions);
        let is_on = Command::Calibration(Some(sensor.is_calibration_on));
        core.take(Event::Line(Ok(is_on)));
        Ok(core)
    }

    /// What the firmware does with an event.
    fn take(&mut self, event: Event) {
        (self.session).take(event, &Vitals::default(), &mut self.actions);
        if let Some(applied) = self.actions.apply.take() {
            let measurement = &mut self.measurement;
            measurement.set_geometry(applied.geometry);
            measurement.set(applied.settings.options(), applied.profile);
            measurement.set_comb(applied.comb.unwrap_or_else(Comb::nominal));
        }
    }

    /// Measures a row by itself, as the sensor does it.
    pub fn measure(&mut self, row: &Row) -> Result<Measured, Fault> {
        // The measurement may change them.
        let mut words = row.words.clone();
        self.measurement
            .measure_alone(&mut words, row.head.exposure, None)
    }

    /// The reading of a result.
    pub fn reading(&mut self, result: Result<Measured, Fault>) -> Result<Reading, Fault> {
        self.take(Event::Frame(result));
        // In binary, each result of the stream is there.
        self.actions
            .result
            .map_or(Err(Fault::SensorSilent), |result| result.result)
    }
}

/// `replay`. The exit code tells whether all rows gave the sensor's bits, unless settings were changed.
pub fn replay(options: &ReplayOptions, output: &mut dyn Write) -> Result<ExitCode> {
    let mut recording = recording::open(&options.file)?;
    let mut core = Core::new(&recording.sensor, &options.set)?;
    let mut table = options.csv.as_deref().map(NewFile::create).transpose()?;
    if let Some(table) = &mut table {
        let columns = "row,time_us,exposure_us,distance_mm,u_mm,r_mm,centre_px,fault";
        writeln!(table, "{columns}").context("the table cannot be written")?;
    }
    let (mut rows, mut same, mut faults) = (0_u64, 0_u64, 0_u64);
    let mut distances = Moments::default();
    // Row by row: a recording may have more rows than fit into memory.
    for row in &mut recording {
        let row = row.with_context(|| format!("{} cannot be read", options.file.display()))?;
        let result = core.measure(&row);
        rows += 1;
        same += u64::from(result == row.head.result);
        let reading = core.reading(result);
        match &reading {
            Ok(reading) => distances.add(reading.distance.to_f64() / 1000.0),
            Err(_) => faults += 1,
        }
        if let Some(table) = &mut table {
            let line = line(&row, &reading);
            (table.write_all(line.as_bytes())).context("the table cannot be written")?;
        }
    }
    let (sensor, damaged) = (&recording.sensor, recording.damaged);
    let (head, sum) = (&sensor.head, sensor.record.sum());
    writeln!(output, "{rows} rows of {head}, record {sum:08x}")?;
    if damaged > 0 {
        let left_out = "packets are damaged, and their rows are left out";
        writeln!(output, "{damaged} {left_out}")?;
    }
    ensure!(rows > 0, "there is no row to measure");
    if let (Some(mean), Some(deviation)) = (distances.mean(), distances.deviation()) {
        let count = distances.count;
        writeln!(
            output,
            "{count} distances: mean {mean:.4} mm, standard deviation {deviation:.4} mm"
        )?;
    }
    writeln!(output, "{faults} faults")?;
    if let (Some(table), Some(path)) = (table, &options.csv) {
        table.finish()?;
        writeln!(output, "written to {}", path.display())?;
    }
    if !options.set.is_empty() {
        writeln!(
            output,
            "with other settings than the sensor's; {same} of {rows} rows give the same bits"
        )?;
    } else if same == rows {
        writeln!(output, "all rows give the bits that the sensor reported")?;
    } else {
        writeln!(
            output,
            "{} of {rows} rows give other bits than the sensor reported: was it another version of the \
             firmware?",
            rows - same
        )?;
        return Ok(ExitCode::FAILURE);
    }
    Ok(ExitCode::SUCCESS)
}

fn line(row: &Row, reading: &Result<Reading, Fault>) -> String {
    let exposure = row.head.exposure.map_or(0, |exposure| exposure.us());
    let mut line = format!("{},{},{exposure},", row.head.number, row.head.time_us);
    match reading {
        Ok(reading) => {
            for length in [reading.distance, reading.uncertainty, reading.parts.noise] {
                line += &format!("{:.6},", length.to_f64() / 1000.0);
            }
            line += &format!("{:.6},", reading.centre.to_f64());
        }
        Err(fault) => line += &format!(",,,,{}", fault.name()),
    }
    line + "\n"
}
