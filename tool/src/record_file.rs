//! A calibration record as a file: the bytes that the sensor keeps in its flash
//! ([`slitrange_device::record`]).

use std::fmt;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use calibration::fixed::part_of_way;
use calibration::points::words;
use calibration::record::profile;
use serde::Serialize;
use slitrange::check::own_spot::Profile;
use slitrange::distance::eq1::Eq1;
use slitrange::distance::knots::{Knot, Knots};
use slitrange::frame::comb::{CORRECTIONS, SlitMap};
use slitrange::reading::uncertainty::FittedErrors;
use slitrange::row::front_end::{Estimate, FrontEnd};
use slitrange::{Calibration, CalibrationErrors, Counts, Micrometres, Pixels, Polarity};
use slitrange_device::record::decode;
use slitrange_device::record::encoded::EncodedRecord;
use slitrange_device::settings::Value;
use statistics::least_and_most;

use crate::whole_file;

/// Centres in the table of what a record says.
const EXAMPLES: i32 = 9;
/// Between two centres at which records are compared: a quarter of a pixel.
const COMPARED: usize = 1 << (Pixels::FRACTION - 2);

/// Reads a record.
pub fn read(path: &Path) -> Result<EncodedRecord> {
    let shown = path.display();
    let bytes = std::fs::read(path).with_context(|| format!("{shown} cannot be read"))?;
    ensure!(
        !is_points(&bytes),
        "{shown} is a CSV file of points, and no record: `slitrange calibrate fit {shown}` makes a record of \
         it"
    );
    let record = decode(&bytes).and_then(EncodedRecord::new);
    record.with_context(|| shown.to_string())
}

/// Whether a file is one of points, which `fit` takes: its header names the columns.
fn is_points(bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes).is_ok_and(|text| text.to_lowercase().contains("x_px"))
}

/// Writes a record, on the disk when this returns; a file that was there is replaced as a whole or not at
/// all, and with other bytes in it only by `force`.
///
/// # Errors
/// Something else is in the file; or the system's.
pub fn write(path: &Path, record: &EncodedRecord, force: bool) -> Result<()> {
    let shown = path.display();
    match std::fs::read(path) {
        _ if force => {}
        Ok(bytes) => ensure!(
            bytes == record.bytes(),
            "{shown} stays as it is, it holds something else than this record: name another file with \
             --output, or replace it with --force"
        ),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
        Err(error) => return Err(error).with_context(|| format!("{shown} cannot be read")),
    }
    whole_file::write(path, record.bytes())
}

/// What a record says, for a person (`Display`) and for a program.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Shown {
    pub(crate) serial_number: u32,
    pub(crate) date: String,
    pub(crate) bytes: usize,
    /// The CRC-32 at the record's end, in hexadecimal digits.
    crc32: String,
    row: ShownRow,
    pub(crate) estimator: String,
    pub(crate) black: String,
    /// Whether the geometry is the nominal one, which holds until a sensor has its own.
    nominal: bool,
    /// `eq1`, `table` or `corrected`.
    kind: &'static str,
    eq1: Option<ShownEq1>,
    table: Option<ShownTable>,
    centres_px: [f64; 2],
    distances_mm: [f64; 2],
    errors: ShownErrors,
    /// The sensor's own spot. None if the calibration did not learn it.
    spot: Option<ShownSpot>,
    examples: Vec<Example>,
    /// None if the front end was not measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    front_end: Option<ShownFrontEnd>,
    /// None for a sensor with one slit.
    #[serde(skip_serializing_if = "Option::is_none")]
    slits: Option<Vec<ShownSlit>>,
}

/// A measured front end: values with their standard uncertainties.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct ShownFrontEnd {
    /// What light does to a word: `rise` or `fall`.
    pub(crate) polarity: &'static str,
    /// Electrons a count.
    pub(crate) gain_electrons: [f64; 2],
    pub(crate) read_noise_counts: [f64; 2],
    /// The count that light does not exceed. None if the target was too dim to show it.
    pub(crate) saturation_counts: Option<[f64; 2]>,
    pub(crate) black_level_counts: [f64; 2],
}

impl ShownFrontEnd {
    pub(crate) fn of(front_end: &FrontEnd) -> Self {
        let counts = |it: &Estimate<Counts>| [it.value.to_f64(), it.u.to_f64()];
        let gain = &front_end.gain;
        Self {
            polarity: polarity_word(front_end.polarity),
            gain_electrons: [gain.value.to_f64(), gain.u.to_f64()],
            read_noise_counts: counts(&front_end.read_noise),
            saturation_counts: front_end.saturation.as_ref().map(counts),
            black_level_counts: counts(&front_end.black_level),
        }
    }
}

impl fmt::Display for ShownFrontEnd {
    /// `10.02 electrons a count (u 0.08), ...`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [gain, gain_u] = self.gain_electrons;
        let [noise, noise_u] = self.read_noise_counts;
        let [black, black_u] = self.black_level_counts;
        write!(
            f,
            "{gain:.2} electrons a count (u {gain_u:.2}), read noise {noise:.2} (u {noise_u:.2}), black \
             {black:.1} (u {black_u:.1}), "
        )?;
        match self.saturation_counts {
            Some([level, u]) => write!(f, "saturated at {level:.1} (u {u:.1})")?,
            None => f.write_str("saturation not measured")?,
        }
        write!(f, "; words {} with light", self.polarity)
    }
}

const fn polarity_word(polarity: Polarity) -> &'static str {
    match polarity {
        Polarity::Rising => "rise",
        Polarity::Falling => "fall",
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct ShownSlit {
    /// From the optical axis along the row.
    place_um: f64,
    /// Coefficients of the correction, lowest degree first, over x0 from the axis in units of 1024 pixels.
    correction_px: [f64; CORRECTIONS],
}

impl ShownSlit {
    fn of(slit: &SlitMap) -> Self {
        Self {
            place_um: slit.place().to_f64(),
            correction_px: slit.correction().map(Pixels::to_f64),
        }
    }
}

/// What a record knows of its errors: the least and the largest standard uncertainty over its centres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
struct ShownErrors {
    /// Of the curve. None if no fit found it.
    curve_um: Option<[f64; 2]>,
    /// By the surface, for a spot of the usual height. None: not told, and the sensor takes an estimate.
    surface_um: Option<[f64; 2]>,
    height_counts: Option<[f64; 2]>,
}

impl ShownErrors {
    fn of(errors: &CalibrationErrors) -> Self {
        let CalibrationErrors::Fitted(FittedErrors { curve, surface }) = errors else {
            return Self::default();
        };
        let um = |values: &[Micrometres]| ends(values.iter().map(|value| value.to_f64()));
        let counts = |values: &[Counts]| ends(values.iter().map(|value| value.to_f64()));
        Self {
            curve_um: Some(um(curve)),
            surface_um: surface.as_ref().map(|surface| um(&surface.deviation)),
            height_counts: surface.as_ref().map(|surface| counts(&surface.height)),
        }
    }
}

/// The sensor's own spot: the least and the largest value over the record's centres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct ShownSpot {
    width_px: [f64; 2],
    lopsided_px: [f64; 2],
}

impl ShownSpot {
    fn of(profile: &Profile) -> Self {
        let rounded = |ends: [f64; 2]| ends.map(|value| (1e4 * value).round() / 1e4);
        Self {
            width_px: rounded(profile::widths(profile)),
            lopsided_px: rounded(profile::lopsided(profile)),
        }
    }
}

/// The least and the largest, to a tenth.
fn ends(values: impl Iterator<Item = f64> + Clone) -> [f64; 2] {
    let least = values.clone().fold(f64::INFINITY, f64::min);
    [least, values.fold(0.0, f64::max)].map(|value| (10.0 * value).round() / 10.0)
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct ShownRow {
    words: usize,
    /// From the first word that sees light to behind the last.
    light: [usize; 2],
    /// The same of shielded pixels.
    shielded: [usize; 2],
    bits: u8,
    /// What light does to a word: `rise` or `fall`.
    polarity: &'static str,
    /// Variance of shot noise for each count of light, in counts.
    shot_variance_per_count: f64,
}

/// Eq. (1) as d = D + K/(x - xp).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct ShownEq1 {
    d_mm: f64,
    k_mm_px: f64,
    xp_px: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct ShownTable {
    /// Centres in pixels, and distances or residuals in micrometres.
    knots: Vec<[f64; 2]>,
}

/// A distance at a centre, and the slope of the curve there, to a thousandth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Example {
    x_px: f64,
    d_mm: f64,
    um_per_px: f64,
}

impl Shown {
    pub(crate) fn of(written: &EncodedRecord) -> Self {
        let record = written.record();
        let (calibration, geometry) = (&record.calibration, &record.geometry);
        let (first, last) = calibration.valid();
        let at = |centre| {
            let (distance, slope) = calibration.distance_at(centre).ok()?;
            Some(Example {
                x_px: centre.to_f64(),
                d_mm: distance.to_f64() / 1e3,
                um_per_px: (f64::from(slope) * 1e3).round() / 1e3,
            })
        };
        let distances = calibration.distances().ok();
        let ends = distances.map_or([Micrometres::default(); 2], |it| [*it.start(), *it.end()]);
        let (kind, eq1, table) = parts(calibration);
        Self {
            serial_number: record.serial_number,
            date: record.date.to_string(),
            bytes: written.bytes().len(),
            crc32: format!("{:08x}", written.sum()),
            row: ShownRow {
                words: geometry.words,
                light: [geometry.light.start, geometry.light.end],
                shielded: [geometry.shielded.start, geometry.shielded.end],
                bits: geometry.bits,
                polarity: polarity_word(geometry.polarity),
                shot_variance_per_count: f64::from(geometry.shot_variance_per_count_q16) / 65536.0,
            },
            estimator: record.estimator.name().to_owned(),
            black: words(Value::Black(record.black_level)),
            nominal: record.is_nominal(),
            kind,
            eq1: eq1.map(|curve| ShownEq1 {
                d_mm: curve.d().to_f64() / 1e3,
                k_mm_px: curve.k() as f64 / 65536.0 / 1e3,
                xp_px: curve.pole().to_f64(),
            }),
            table: table.map(|knots| {
                let numbers = |knot: Knot| [knot.centre.to_f64(), knot.value.to_f64()];
                let knots = knots.iter().map(numbers).collect();
                ShownTable { knots }
            }),
            centres_px: [first.to_f64(), last.to_f64()],
            distances_mm: ends.map(|end| end.to_f64() / 1e3),
            errors: ShownErrors::of(&record.errors),
            spot: record.profile.as_ref().map(ShownSpot::of),
            examples: (0..EXAMPLES)
                .filter_map(|index| at(part_of_way(first, last, index, EXAMPLES - 1)))
                .collect(),
            front_end: record.front_end.as_ref().map(ShownFrontEnd::of),
            slits: (record.comb.as_ref())
                .map(|comb| comb.slits().iter().map(ShownSlit::of).collect()),
        }
    }

    /// Names and values that a person reads, one a line.
    fn fields(&self) -> Vec<(&'static str, String)> {
        let mut fields = Vec::new();
        let mut add = |name, value: String| fields.push((name, value));
        let row = &self.row;
        let ([from, to], [first, last]) = (row.light, row.shielded);
        add("serial number", self.serial_number.to_string());
        add("date", self.date.clone());
        add("bytes", self.bytes.to_string());
        add("CRC-32", self.crc32.clone());
        let pixels = format!("light {from}..{to}, shielded {first}..{last}");
        add("row", format!("{} words: {pixels}", row.words));
        let counts = format!(
            "{} bits that {} with light, shot noise {:.5} counts^2 a count",
            row.bits, row.polarity, row.shot_variance_per_count
        );
        add("counts", counts);
        let front_end = self.front_end.map(|front_end| front_end.to_string());
        let not_measured = || "not measured: the sensor assumes a usual one".to_owned();
        add("front end", front_end.unwrap_or_else(not_measured));
        add("estimator", self.estimator.clone());
        add("black level", self.black.clone());
        let calibration = match self.kind {
            _ if self.nominal => "d = D + K/(x - xp), nominal: the sensor has none of its own",
            "eq1" => "d = D + K/(x - xp)",
            "table" => "a table of distances",
            _ => "d = D + K/(x - xp), plus a table of residuals",
        };
        add("calibration", calibration.to_owned());
        if let Some(eq1) = self.eq1 {
            add("D", format!("{:.4} mm", eq1.d_mm));
            add("K", format!("{:.5} mm px", eq1.k_mm_px));
            add("xp", format!("{:.5} px", eq1.xp_px));
        }
        if let Some(ShownTable { knots }) = &self.table {
            add(
                "knots",
                format!("{}, monotone cubics between them", knots.len()),
            );
        }
        let [first, last] = self.centres_px;
        add("centres", format!("{first:.5} to {last:.5} px"));
        let [least, most] = self.distances_mm;
        add("distances", format!("{least:.4} to {most:.4} mm"));
        let curve = match (self.errors.curve_um, self.nominal) {
            (Some([least, most]), _) => format!("standard uncertainty {least:.1} to {most:.1} um"),
            (None, true) => "tolerances of a head that was never calibrated".to_owned(),
            (None, false) => "uncertainty not in the record: fit again to have it".to_owned(),
        };
        add("curve", curve);
        let surface = match self.errors.surface_um.zip(self.errors.height_counts) {
            Some(([least, most], [dim, bright])) => format!(
                "moves distances by {least:.0} to {most:.0} um, at a height of {dim:.0} to {bright:.0} counts"
            ),
            None => "not in the record: the sensor takes an estimate".to_owned(),
        };
        add("surface", surface);
        let spot = match self.spot.map(|spot| (spot.width_px, spot.lopsided_px)) {
            Some(([least, most], [even, odd])) => {
                format!("width {least:.3} to {most:.3} px, lopsided by {even:.4} to {odd:.4} px")
            }
            None => "not in the record: any symmetric spot counts as clean".to_owned(),
        };
        add("spot", spot);
        if let Some(slits) = &self.slits {
            let of = |value: fn(&ShownSlit) -> f64| least_and_most(slits.iter().map(value));
            let (left, right) = of(|slit| slit.place_um);
            let (least, most) = of(|slit| slit.correction_px[0]);
            let count = slits.len();
            let slits = format!(
                "{count}, from {left:.0} to {right:.0} um; corrections on the axis {least:+.4} to {most:+.4} px"
            );
            add("slits", slits);
        }
        fields
    }
}

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (name, value) in self.fields() {
            writeln!(f, "{name:<14}{value}")?;
        }
        write!(f, "\n{:>12}  {:>11}  {:>8}", "x px", "d mm", "um a px")?;
        for it in &self.examples {
            let (px, mm, um) = (it.x_px, it.d_mm, it.um_per_px);
            write!(f, "\n{px:>12.3}  {mm:>11.4}  {um:>8.2}")?;
        }
        let Some(slits) = &self.slits else {
            return Ok(());
        };
        write!(
            f,
            "\n\n{:>4}  {:>8}  correction px, by powers of (x0 - axis) / 1024 px",
            "slit", "place um"
        )?;
        for (slit, number) in slits.iter().zip(1..) {
            write!(f, "\n{number:>4}  {:>8.0}", slit.place_um)?;
            for term in slit.correction_px {
                write!(f, "  {term:>+9.4}")?;
            }
        }
        Ok(())
    }
}

fn parts(calibration: &Calibration) -> (&'static str, Option<&Eq1>, Option<&Knots>) {
    match calibration {
        Calibration::Eq1(curve) => ("eq1", Some(curve), None),
        Calibration::Table(table) => ("table", None, Some(table.knots())),
        Calibration::Corrected(it) => ("corrected", Some(it.curve()), Some(it.residuals())),
    }
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Comparison {
    /// Bit for bit.
    pub(crate) same: bool,
    differences: Vec<Difference>,
    /// Knots of the two tables that are not the same, where both have as many.
    knots_differ: usize,
    /// The centres for which both are valid.
    common_px: Option<[f64; 2]>,
    /// By how much their distances differ most over those centres.
    largest: Option<Largest>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
struct Difference {
    field: &'static str,
    first: String,
    second: String,
}

/// The largest difference of distances: the second's less the first's, and where.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Largest {
    um: f64,
    x_px: f64,
}

impl Comparison {
    pub(crate) fn of(first: &EncodedRecord, second: &EncodedRecord) -> Self {
        let (a, b) = (Shown::of(first), Shown::of(second));
        let value = |fields: &[(&str, String)], name: &str| {
            let field = fields.iter().find(|(field, _)| *field == name);
            field.map_or("none".to_owned(), |(_, value)| value.clone())
        };
        let (ours, theirs) = (a.fields(), b.fields());
        let is_further = |(name, _): &&(&str, String)| value(&ours, name) == "none";
        let differences = (ours.iter().chain(theirs.iter().filter(is_further)))
            .map(|&(field, _)| Difference {
                field,
                first: value(&ours, field),
                second: value(&theirs, field),
            })
            .filter(|difference| difference.first != difference.second)
            .collect();
        let knots_differ = match (&a.table, &b.table) {
            (Some(a), Some(b)) if a.knots.len() == b.knots.len() => {
                a.knots.iter().zip(&b.knots).filter(|(a, b)| a != b).count()
            }
            _ => 0,
        };
        let (common_px, largest) = distances_apart(first, second);
        Self {
            same: first.bytes() == second.bytes(),
            differences,
            knots_differ,
            common_px,
            largest,
        }
    }
}

/// The centres that both records are valid for, and where their distances differ most.
fn distances_apart(
    first: &EncodedRecord,
    second: &EncodedRecord,
) -> (Option<[f64; 2]>, Option<Largest>) {
    let calibrations = [first, second].map(|written| &written.record().calibration);
    let [(a, b), (c, d)] = calibrations.map(Calibration::valid);
    let (from, to) = (a.max(c), b.min(d));
    if from > to {
        return (None, None);
    }
    let grid = (from.to_bits()..=to.to_bits()).step_by(COMPARED);
    let grid = grid.map(Pixels::from_bits);
    let knots = calibrations.into_iter().flat_map(|calibration| {
        let (.., knots) = parts(calibration);
        let knots = knots.into_iter().flat_map(Knots::iter);
        knots.map(|knot| knot.centre)
    });
    let largest = grid
        .chain(knots.filter(|centre| (from..=to).contains(centre)))
        .chain([to])
        .filter_map(|centre| {
            let [a, b] = calibrations.map(|calibration| calibration.distance_at(centre).ok());
            Some(Largest {
                um: b?.0.to_f64() - a?.0.to_f64(),
                x_px: centre.to_f64(),
            })
        })
        .max_by(|a, b| a.um.abs().total_cmp(&b.um.abs()));
    (Some([from.to_f64(), to.to_f64()]), largest)
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.same {
            return f.write_str("the same, bit for bit");
        }
        f.write_str("they differ")?;
        for it in &self.differences {
            write!(f, "\n{:<14}{}\n{:<14}{}", it.field, it.first, "", it.second)?;
        }
        if self.knots_differ > 0 {
            write!(f, "\n{:<14}{} are not the same", "knots", self.knots_differ)?;
        }
        match (self.common_px, self.largest) {
            (Some([from, to]), Some(Largest { um, x_px })) => write!(
                f,
                "\nfrom {from:.1} to {to:.1} px, their distances differ by at most {:.3} um, at {x_px:.3} px",
                um.abs()
            ),
            _ => f.write_str("\nthere is no centre for which both are valid"),
        }
    }
}
