//! `design`: what a sensor of given dimensions can do, from closed forms, before anybody builds it.
//!
//! Lengths are in millimetres; errors are standard deviations in micrometres of distance.

mod drawing;
pub mod errors;
pub mod geometry;
pub mod light;

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context as _, Result, ensure};
use clap::ValueEnum;

use errors::At;
use geometry::{COMB_SLITS, Geometry};

/// Compute range, resolution and accuracy of a sensor from its dimensions, before you build it
///
/// It prints the parts of the error at five distances, and which part is the largest. It needs no sensor.
/// Speckle and pixels are estimates by closed forms that agree with the simulation to a quarter.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = include_str!("design.help.txt").trim_ascii_end())]
pub struct DesignOptions {
    /// From the laser's beam to the slit
    #[arg(long, value_name = "MM", default_value_t = 300.0)]
    pub baseline: f64,
    /// The nearest distance
    #[arg(long, value_name = "MM", default_value_t = 600.0)]
    pub near: f64,
    /// The farthest distance
    #[arg(long, value_name = "MM", default_value_t = 1020.0)]
    pub far: f64,
    /// Width of the slit
    #[arg(
        long,
        value_name = "UM",
        default_value_t = 200.0,
        conflicts_with = "comb"
    )]
    pub slit: f64,
    /// The mask with 16 slits of 200 um in place of one slit
    #[arg(long)]
    pub comb: bool,
    /// 1/e^2 diameter of the laser's spot on the target
    #[arg(long, value_name = "MM", default_value_t = 1.0)]
    pub spot: f64,
    /// From the slit to the sensor
    #[arg(long, value_name = "MM", default_value_t = 50.0)]
    pub slit_to_sensor: f64,
    /// u, between the baseline and the optical axis. Without it: near and far lie evenly about the row's
    /// middle. The firmware's nominal calibration has 68.9624
    #[arg(long, value_name = "DEGREES")]
    pub angle: Option<f64>,
    /// The laser's wavelength
    #[arg(long, value_name = "NM", default_value_t = 650.0)]
    pub wavelength: f64,
    /// What the laser and the target's surface do to speckle
    #[arg(long, value_enum, default_value_t = Surface::Paper)]
    pub surface: Surface,
    /// Height of the spot in counts of the converter
    #[arg(long, value_name = "COUNTS", default_value_t = 2000.0)]
    pub height: f64,
    /// Electrons a count. A full pixel of the TCD1304DG has 40,000 electrons and 4096 counts
    #[arg(long, value_name = "N", default_value_t = 10.0)]
    pub electrons: f64,
    /// Noise of an unlit pixel
    #[arg(long, value_name = "COUNTS", default_value_t = 4.0)]
    pub noise: f64,
    /// Rows of a frame
    #[arg(long, value_name = "N", default_value_t = 16)]
    pub rows: u32,
    /// How much the pixels differ in their response, standard deviation
    #[arg(long, value_name = "PERCENT", default_value_t = 2.8)]
    pub pixels: f64,
    /// Points of the calibration, each at another place of the surface
    #[arg(long, value_name = "N", default_value_t = 30)]
    pub points: u32,
    /// How well the distance of each point of the calibration is known
    #[arg(long, value_name = "UM", default_value_t = 10.0)]
    pub stage: f64,
    /// Change of temperature since the calibration
    #[arg(long, value_name = "KELVIN", default_value_t = 1.0)]
    pub warmer: f64,
    /// By how much frame and mount grow for a kelvin: 23 for aluminium, 11 for steel, 1 for carbon fibre
    #[arg(long, value_name = "PPM", default_value_t = 23.0)]
    pub expansion: f64,
    /// Also draw laser, slit, sensor and target to scale
    #[arg(long, value_name = "SVG")]
    pub drawing: Option<PathBuf>,
}

/// The TCD1304DG: from pixel to pixel in mm, and how many pixels.
const PIXELS: (f64, usize) = (0.008, 3648);

/// How many equal speckle patterns the sensor sees at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Surface {
    /// A laser of a single wavelength, a surface that depolarises: two patterns
    Paper,
    /// A laser diode with a line of 1 nm, on a material that its light enters by 0.1 mm: four patterns
    DiodeOnPaper,
    /// A single wavelength, a surface that keeps the polarisation: one pattern
    Metal,
}

impl Surface {
    const fn patterns(self) -> f64 {
        match self {
            Self::Paper => 2.0,
            Self::DiodeOnPaper => 4.0,
            Self::Metal => 1.0,
        }
    }
}

/// A design whose numbers make sense.
#[derive(Clone, Debug)]
pub struct Design {
    /// Laser, slit and sensor.
    pub geometry: Geometry,
    options: DesignOptions,
    slit: f64,
    /// Wavelength in mm.
    wavelength: f64,
}

impl DesignOptions {
    /// The design.
    pub fn design(&self) -> Result<Design> {
        for (name, value, least, most) in [
            ("--baseline", self.baseline, 1.0, 1e5),
            ("--near", self.near, 1.0, 1e5),
            ("--far", self.far, 1.0, 1e5),
            ("--slit", self.slit, 1.0, 1e4),
            ("--spot", self.spot, 0.01, 100.0),
            ("--slit-to-sensor", self.slit_to_sensor, 1.0, 1000.0),
            ("--wavelength", self.wavelength, 200.0, 2000.0),
            ("--height", self.height, 1.0, 4096.0),
            ("--electrons", self.electrons, 0.1, 1e4),
            ("--noise", self.noise, 0.01, 1000.0),
            ("--rows", f64::from(self.rows), 1.0, 65535.0),
            ("--pixels", self.pixels, 0.0, 100.0),
            // Eq. (1) has three parameters.
            ("--points", f64::from(self.points), 3.0, 10000.0),
            ("--stage", self.stage, 0.0, 1e4),
            ("--warmer", self.warmer, 0.0, 100.0),
            ("--expansion", self.expansion, 0.0, 1000.0),
        ] {
            ensure!(
                (least..=most).contains(&value),
                "{name} must be between {least} and {most}"
            );
        }
        ensure!(
            self.far >= 1.001 * self.near,
            "--far must be beyond --near, by a thousandth at least"
        );
        let wavelength = 1e-6 * self.wavelength;
        let slit = 1e-3 * self.slit;
        ensure!(
            slit >= 4.0 * wavelength && slit <= 0.1 * self.slit_to_sensor,
            "--slit must be between four wavelengths and a tenth of --slit-to-sensor"
        );
        // Outside, Fresnel's integral takes too long.
        let nearest = self.baseline.hypot(self.near);
        let fresnel = slit * slit / wavelength * (1.0 / self.slit_to_sensor + 1.0 / nearest);
        ensure!(
            (0.01..=16.0).contains(&fresnel),
            "--slit squared, over wavelength and --slit-to-sensor, must be between 0.01 and 16: it is \
             {fresnel:.3}"
        );
        let (near, far) = (self.near, self.far);
        let mut geometry = Geometry::new(self.baseline, self.slit_to_sensor, PIXELS, near, far);
        if let Some(degrees) = self.angle {
            ensure!(
                degrees > 0.0 && degrees < 90.0,
                "--angle must be between 0 and 90 degrees"
            );
            geometry.angle = degrees.to_radians();
        }
        Ok(Design {
            geometry,
            options: self.clone(),
            slit,
            wavelength,
        })
    }
}

impl Design {
    /// The nearest and the farthest distance that the whole sensor sees.
    fn sees(&self) -> Option<(f64, f64)> {
        let options = &self.options;
        let reach = 4.0 * self.width(options.near).max(self.width(options.far));
        self.geometry.usable(reach, options.comb)
    }

    /// Whether the sensor sees the whole range.
    fn fits(&self) -> bool {
        let DesignOptions { near, far, .. } = self.options;
        self.sees()
            .is_some_and(|(first, last)| first <= near && last >= far)
    }

    /// What is between the target and the sensor.
    fn mask(&self) -> String {
        match self.options.comb {
            true => format!("comb of {COMB_SLITS} slits"),
            false => format!("slit of {} um", self.options.slit),
        }
    }
}

/// The distances of the table.
const COLUMNS: usize = 5;

/// `design`.
pub fn design(options: &DesignOptions, output: &mut dyn Write) -> Result<()> {
    let design = options.design()?;
    let step = (options.far - options.near) / (COLUMNS - 1) as f64;
    let distances = (0..COLUMNS).map(|i| options.near + step * i as f64);
    let at: Vec<At> = distances.map(|distance| design.at(distance)).collect();
    print_dimensions(&design, output)?;
    print_parts(&at, output)?;
    print_changes(options, &at[COLUMNS - 1], output)?;
    print_tolerances(&design.geometry, &at, output)?;
    if let Some(path) = &options.drawing {
        std::fs::write(path, drawing::svg(&design)).with_context(|| path.display().to_string())?;
        writeln!(output, "\ndrawn: {}", path.display())?;
    }
    Ok(())
}

fn print_dimensions(design: &Design, output: &mut dyn Write) -> Result<()> {
    let (geometry, options) = (&design.geometry, &design.options);
    let (pitch, pixels) = PIXELS;
    let (d, k, pole) = geometry.eq1();
    let (sign, size) = (if pole < 0.0 { "+" } else { "-" }, pole.abs());
    let (degrees, tan) = (geometry.angle.to_degrees(), geometry.angle.tan());
    let (sin, cos) = geometry.angle.sin_cos();
    let (first, last) = geometry.ends(options.near, options.far, options.comb);
    let sees = match design.sees() {
        Some((near, far)) => format!("{} to {}", mm(near), mm(far)),
        None => "no distance".to_owned(),
    };
    writeln!(
        output,
        "laser    {} nm, spot {} mm on the target, {} mm beside the slit\n\
         sensor   TCD1304DG, {pixels} pixels of {:.0} um, {} mm behind a {}\n\
         angle u  {degrees:.2} degrees from the baseline to the optical axis, tan u {tan:.4}\n\
         eq. (1)  d = {d:.3} mm + {k:.0} mm px / (x {sign} {size:.2} px)\n\
         row      its middle is {:.2} mm further from the beam than the slit, and {:.2} mm behind it\n\
         pixels   {first:.0} to {last:.0}, {:.0} % of the sensor; the whole sensor sees {sees}",
        options.wavelength,
        options.spot,
        options.baseline,
        1000.0 * pitch,
        options.slit_to_sensor,
        design.mask(),
        geometry.focal * cos,
        geometry.focal * sin,
        100.0 * (last - first) / pixels as f64,
    )?;
    if !design.fits() {
        let mut centred = options.clone();
        centred.angle = None;
        let centred = centred.design()?;
        let advice = match options.angle.is_some() && centred.fits() {
            true => format!("take --angle {:.4}.", centred.geometry.angle.to_degrees()),
            false => "take a shorter slit-to-sensor distance, or a smaller range.".to_owned(),
        };
        writeln!(
            output,
            "         The range does not fit on the sensor: {advice}"
        )?;
    }
    Ok(())
}

/// A line of a table: a name, and what it is at each distance.
fn row(name: &str, at: &[At], value: impl Fn(&At) -> String) -> String {
    let values = at.iter().map(|at| format!("{:>13}", value(at)));
    format!("{name:<28}{}", values.collect::<String>())
}

fn print_parts(at: &[At], output: &mut dyn Write) -> Result<()> {
    let mut lines = vec![
        String::new(),
        row("distance, mm", at, |at| format!("{:.0}", at.distance)),
        row("centre, pixel", at, |at| format!("{:.1}", at.centre)),
        row("width (sigma), pixels", at, |at| format!("{:.2}", at.width)),
        row("a pixel, um", at, |at| um(at.um_a_pixel)),
        row("speckle at the slit, um", at, |at| um(at.speckle_size)),
        row("noise of one row, um", at, |at| um(at.noise_of_a_row)),
    ];
    for (i, (name, _)) in at[0].parts.iter().enumerate() {
        let name = format!("frame: {name}, um");
        lines.push(row(&name, at, |at| um(at.parts[i].1)));
    }
    lines.push(row("total, um", at, |at| um(at.total())));
    lines.push(row("the largest part", at, |at| at.limit().to_owned()));
    Ok(writeln!(output, "{}", lines.join("\n"))?)
}

fn print_changes(options: &DesignOptions, now: &At, output: &mut dyn Write) -> Result<()> {
    let (mm, total) = (now.distance, um(now.total()));
    writeln!(output, "\ntotal at {mm:.0} mm now: {total} um. It would be")?;
    let with = |change: &dyn Fn(&mut DesignOptions)| {
        let mut changed = options.clone();
        change(&mut changed);
        changed
    };
    let mut changes = vec![
        ("half the laser's spot", with(&|it| it.spot *= 0.5)),
        (
            "half as much baseline again",
            with(&|it| (it.baseline, it.angle) = (1.5 * options.baseline, None)),
        ),
        ("four times the rows", with(&|it| it.rows *= 4)),
        (
            "a map of the pixels (head flat)",
            with(&|it| it.pixels = 0.0),
        ),
        ("four times the points", with(&|it| it.points *= 4)),
    ];
    if !options.comb {
        changes.insert(1, ("the comb of 16 slits", with(&|it| it.comb = true)));
    }
    for (name, changed) in changes {
        // A change may leave the limits of an option.
        let Ok(design) = changed.design() else {
            continue;
        };
        let at = design.at(options.far);
        let fits = if design.fits() { "" } else { "; does not fit" };
        let (total, limit) = (um(at.total()), at.limit());
        writeln!(
            output,
            "{total:>9} um with {name}; then {limit} is the largest part{fits}"
        )?;
    }
    writeln!(
        output,
        "Speckle is that of a target at rest, or of one row. A target that moves shows other speckle after \
         some\nmillimetres."
    )?;
    Ok(())
}

fn print_tolerances(geometry: &Geometry, at: &[At], output: &mut dyn Write) -> Result<()> {
    writeln!(
        output,
        "\nby how much a wrong dimension moves the distance, in mm, without a calibration"
    )?;
    for (i, (name, _)) in geometry.tolerances(at[0].distance).iter().enumerate() {
        let line = row(name, at, |at| match geometry.tolerances(at.distance)[i].1 {
            mm if mm < 1e7 => format!("{mm:.2}"),
            mm => format!("{mm:.2e}"),
        });
        writeln!(output, "{line}")?;
    }
    let far = at[at.len() - 1].distance;
    let crept = geometry.distance(geometry.behind(0.001).centre(far)) - far;
    writeln!(
        output,
        "A calibration takes all of these away. What moves after it stays: a slit that creeps by 1 um along \
         the row\nmoves the distance by {} um at {:.0} mm.",
        um(1000.0 * crept.abs()),
        far
    )?;
    Ok(())
}

/// Micrometres with three digits or so.
fn um(value: f64) -> String {
    match value {
        value if value < 0.01 => format!("{value:.4}"),
        value if value < 1.0 => format!("{value:.3}"),
        value if value < 10.0 => format!("{value:.2}"),
        value if value < 100.0 => format!("{value:.1}"),
        value if value < 1e7 => format!("{value:.0}"),
        value => format!("{value:.2e}"),
    }
}

/// A distance, which may be infinite.
fn mm(value: f64) -> String {
    match value.is_finite() {
        true => format!("{value:.0} mm"),
        false => "any distance".to_owned(),
    }
}
