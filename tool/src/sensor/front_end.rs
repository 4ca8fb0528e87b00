//! Measures the front end of a sensor, and writes what it measured into the sensor's record.

mod bench;
mod figure;

use std::fmt::Write as _;
use std::io::Write;
use std::path::PathBuf;

use anyhow::{Result, bail, ensure};
use slitrange::base::units::{Counts, Electrons};
use slitrange::row::front_end::{Estimate, FrontEnd, LARGEST_GAIN, LEAST_GAIN};
use slitrange::row::{Geometry, Polarity};
use slitrange_device::record::Record;
use slitrange_device::record::encoded::EncodedRecord;
use slitrange_device::settings::{Setting, Value};

use self::bench::{Bench, Taken};
use super::port::PortOption;
use super::transfer::{record_in_use, transfer};
use crate::pc::Pc;
use crate::photon_transfer::{Transfer, VARIANCE_OF_ROUNDING};
use crate::record_file::ShownFrontEnd;
use crate::whole_file;

/// Measure the amplifier and the converter: gain, noise, saturation
///
/// Put a white target at rest before the sensor, in the middle of its range, and shade both from lamps that
/// flicker. The sensor takes rows with the laser off and then with longer and longer exposures, for one to
/// five minutes. From how the noise grows with the light follow the electrons of a count and the read noise;
/// from where the light grows no more, the saturation. All this goes into the sensor's record. The
/// uncertainty of every reading depends on it.
#[derive(Clone, Debug, clap::Args)]
pub struct MeasureOptions {
    #[command(flatten)]
    port: PortOption,
    /// Write a table: signal and variance of each pixel and exposure
    #[arg(long, value_parser = whole_file::output)]
    csv: Option<PathBuf>,
    /// Draw the noise over the light, and the light over the exposure, as an SVG
    #[arg(long, value_parser = whole_file::output)]
    figure: Option<PathBuf>,
    /// Leave the flash as it is: what was measured is used until the power goes
    #[arg(long)]
    no_save: bool,
    /// Measure and report, but leave the sensor as it is
    #[arg(long)]
    dry_run: bool,
}

/// The settings that measuring changes.
const CHANGED: [Setting; 3] = [Setting::Ambient, Setting::Exposure, Setting::Laser];
/// The settings that the upload of a record changes.
const OF_RECORD: [Setting; 3] = [Setting::Estimator, Setting::Black, Setting::Slits];

/// `head measure`.
pub fn measure(options: &MeasureOptions, pc: &dyn Pc, output: &mut dyn Write) -> Result<()> {
    // From now on, Ctrl-C ends the measurement in order.
    pc.interrupted();
    let mut session = options.port.open(pc)?;
    writeln!(output, "sensor {} at {}", session.head(), session.port())?;
    let keeps_flash = options.no_save || options.dry_run;
    let in_use = session.calibration()?;
    ensure!(
        keeps_flash || matches!(in_use.stored.as_str(), "same" | "none"),
        "the sensor's flash holds another calibration ({}) than the one in use, which would be lost: switch \
         the sensor off and on to use it, or save the one in use first, or measure with --no-save",
        in_use.stored
    );
    let record = record_in_use(&mut session)?.record().clone();
    let geometry = match &record.front_end {
        Some(front_end) => front_end.geometry(&record.geometry),
        None => record.geometry.clone(),
    };
    ensure!(
        session.value(Setting::Laser)? == Value::Laser(true),
        "the laser is off: type `laser on` on the sensor's line, if nobody looks into the beam, and measure \
         again"
    );
    let Value::ExposureLimit(limit) = session.value(Setting::ExposureLimit)? else {
        bail!("the sensor says no `exposure limit`");
    };
    // The map corrects rows with a spot only, so they could not be compared with dark rows.
    session.borrow_without_map()?;
    let found = session.settings(&OF_RECORD)?;
    let of_record = OF_RECORD.map(|setting| found.get(setting));
    let taken = Bench::new(&mut session, &geometry, limit).take(output)?;
    let front_end = front_end(&taken, geometry.polarity)?;
    report(&front_end, &geometry, output)?;
    // `save` keeps the settings as they were before.
    session.give_back(&CHANGED)?;
    if options.dry_run {
        writeln!(output, "a dry run: the sensor goes on as before")?;
    } else {
        let written = EncodedRecord::new(Record {
            front_end: Some(front_end),
            ..record
        })?;
        // The estimator, the black level and the slits stay as they were set.
        transfer(session, &written, &of_record, !options.no_save)?;
        let kept = match options.no_save {
            true => "in use, but not saved: it is used until the power goes",
            false => "in use and saved, with the settings as they are",
        };
        writeln!(output, "{kept}")?;
    }
    if let Some(path) = &options.csv {
        whole_file::write(path, csv(&taken.photons).as_bytes())?;
        writeln!(output, "written: {}", path.display())?;
    }
    if let Some(path) = &options.figure {
        figure::draw(&taken, &front_end, path)?;
        writeln!(output, "drawn: {}", path.display())?;
    }
    Ok(())
}

fn front_end(taken: &Taken, in_use: Polarity) -> Result<FrontEnd> {
    let line = &taken.photons.line;
    let gain = 1.0 / line.per_count;
    let (least, largest) = (LEAST_GAIN.to_f64(), LARGEST_GAIN.to_f64());
    ensure!(
        (least..=largest).contains(&gain),
        "{gain:.2} electrons a count were measured, and a sensor uses {least:.0} to {largest:.0}: check that \
         the target and the light are at rest, and change the amplifier's gain if it is so"
    );
    // The variance in the dark has the noise of the light that is there with the laser off, too.
    let [black, black_u] = taken.black;
    let ambient = (taken.dark_level - black).max(0.0);
    let read = line.dark - VARIANCE_OF_ROUNDING - line.per_count * ambient;
    let read_u = line.dark_u.hypot(line.per_count_u * ambient);
    let read_noise = read.max(0.0).sqrt();
    let polarity = match taken.is_inverted == (in_use == Polarity::Rising) {
        true => Polarity::Falling,
        false => Polarity::Rising,
    };
    let counts = |[value, u]: [f64; 2]| Estimate {
        value: Counts::from_f32(value as f32),
        u: Counts::from_f32(u as f32),
    };
    Ok(FrontEnd {
        polarity,
        gain: Estimate {
            value: Electrons::from_f32(gain as f32),
            u: Electrons::from_f32((gain * gain * line.per_count_u) as f32),
        },
        // Near zero the root is no longer straight.
        read_noise: counts([read_noise, read_u / (2.0 * read_noise).max(read_u.sqrt())]),
        saturation: taken.saturation.map(counts),
        black_level: counts([black, black_u]),
    })
}

fn report(front_end: &FrontEnd, in_use: &Geometry, output: &mut dyn Write) -> Result<()> {
    let ShownFrontEnd {
        polarity,
        gain_electrons: [gain, gain_u],
        read_noise_counts: [noise, noise_u],
        saturation_counts,
        black_level_counts: [black, black_u],
    } = ShownFrontEnd::of(front_end);
    let until_now = in_use.electrons_per_count();
    let saturation = match saturation_counts {
        Some([level, u]) => format!("{level:.1} counts, u {u:.1}"),
        None => "not measured: put a brighter target before the sensor, or raise `exposure limit`"
            .into(),
    };
    writeln!(
        output,
        "gain         {gain:.2} electrons a count, u {gain_u:.2} (until now {until_now})\n\
         read noise   {noise:.2} counts, u {noise_u:.2}\n\
         saturation   {saturation}\n\
         black level  {black:.2} counts, u {black_u:.2}\n\
         polarity     the words {polarity} with light"
    )?;
    if front_end.polarity != in_use.polarity {
        let until_now = "until now the firmware took it the other way round";
        writeln!(output, "             {until_now}")?;
    }
    Ok(())
}

/// A line for each pixel and exposure, and one for the rows in the dark.
fn csv(transfer: &Transfer) -> String {
    let mut text = "signal_counts,variance_counts2,freedom,line_counts2\n".to_owned();
    for point in &transfer.points {
        let (signal, variance, freedom) = (point.signal, point.variance, point.freedom);
        let line = transfer.line.at(signal);
        let _ = writeln!(text, "{signal:.2},{variance:.3},{freedom:.1},{line:.3}");
    }
    text
}
