//! What a person, or a program, is told of a fit.

use std::fmt;
use std::path::Path;

use calibration::fit::comb::FittedComb;
use calibration::fit::curve::{FEW_FREEDOMS, Quality};
use calibration::fit::observed::Weights;
use calibration::fit::order::FEWEST_TO_REJECT;
use calibration::fit::repeats::Repeats;
use calibration::fit::solve::{Form, Solved};
use calibration::record::form::Made;
use calibration::record::surface::Surface;
use calibration::record::verdict::{SCATTERED, Verdict};
use serde::Serialize;
use slitrange_device::record::encoded::EncodedRecord;

use crate::record_file::Shown;

/// The report. Units stand in the names.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    verdict: Verdict,
    file: String,
    /// Distances with a point.
    points: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    repeats: Option<Repeats>,
    used: usize,
    rejected: Vec<Rejected>,
    form: Form,
    form_because: String,
    eq1: Parameters,
    /// How the centres lie to xp.
    pole: Pole,
    /// How well eq. (1) alone goes with the points.
    eq1_alone: Residuals,
    /// How well the curve of that form does.
    curve: Residuals,
    range: Range,
    table: Option<Table>,
    /// How far the sensor's distances are from the curve, by rounding and tabulation, at most.
    held_within_um: f64,
    /// What was known of the points' errors.
    weights: String,
    /// The points' scatter over what was given of their errors; without that, that of the centres in pixels.
    scatter: Option<f64>,
    surface: Option<ShownSurface>,
    #[serde(skip_serializing_if = "Option::is_none")]
    comb: Option<FittedComb>,
    cannot_show: Vec<String>,
    record: Option<RecordWritten>,
}

#[derive(Clone, Debug, Serialize)]
struct Rejected {
    line: u64,
    x_px: f64,
    d_mm: f64,
    /// Its distance less that of the curve at its centre.
    off_mm: f64,
    /// How many times its standard uncertainty that is.
    off_deviations: f64,
}

/// A parameter with its standard uncertainty, where that is known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Value {
    value: f64,
    uncertainty: Option<f64>,
}

#[derive(Clone, Debug, Serialize)]
struct Parameters {
    d_mm: Value,
    k_mm_px: Value,
    xp_px: Value,
    /// Correlation of D with K, D with xp, K with xp.
    correlation: [f64; 3],
    /// Covariance in the order D, K, xp, where it is known.
    covariance: Option<[[f64; 3]; 3]>,
}

/// How far the pole is from the nearest centre of the range, and the same over the range's length.
#[derive(Clone, Copy, Debug, Serialize)]
struct Pole {
    from_range_px: f64,
    ranges_away: f64,
}

/// How well a curve goes with its points.
#[derive(Clone, Copy, Debug, Serialize)]
struct Residuals {
    /// How many parameters it is worth.
    freedoms: f64,
    rms_um: f64,
    largest_um: f64,
    /// Root mean square of each point's distance from the curve that the others make.
    cross_validated_um: Option<f64>,
    /// Root mean square of the curve's own standard uncertainty over the range.
    uncertainty_um: Option<f64>,
    largest_uncertainty_um: Option<f64>,
    /// The part of an error of the point at the first centre that the curve takes over.
    leverage_first: f64,
    leverage_last: f64,
}

/// How far a target's surface moves distances: more with the distance, and as 1 / sqrt(height).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct ShownSurface {
    /// The distance in the middle of the points.
    middle_mm: f64,
    /// Standard deviation there, of a spot of the usual height.
    deviation_um: f64,
    /// How well that is known, over itself.
    known_to: f64,
    /// The usual height there.
    height_counts: f64,
}

/// The ends of the centres and distances for which a calibration holds.
#[derive(Clone, Copy, Debug, Serialize)]
struct Range {
    first_px: f64,
    last_px: f64,
    first_mm: f64,
    last_mm: f64,
}

#[derive(Clone, Copy, Debug, Serialize)]
struct Table {
    knots: usize,
}

#[derive(Clone, Debug, Serialize)]
struct RecordWritten {
    file: String,
    bytes: usize,
    serial: u32,
    date: String,
    estimator: String,
    black: String,
}

impl Residuals {
    fn of(quality: &Quality, freedoms: f64) -> Self {
        let um = |metres: f64| 1e6 * metres;
        Self {
            freedoms,
            rms_um: um(quality.rms),
            largest_um: um(quality.largest),
            cross_validated_um: quality.cross_validated.map(um),
            uncertainty_um: quality.uncertainty.map(um),
            largest_uncertainty_um: quality.largest_uncertainty.map(um),
            leverage_first: quality.leverages.0,
            leverage_last: quality.leverages.1,
        }
    }
}

impl Report {
    /// That of a calibration, and of a comb if the sensor has one.
    pub fn of(file: String, solved: &Solved, made: &Made<'_>, comb: Option<&FittedComb>) -> Self {
        let (curve, quality) = (made.curve, solved.quality(made.form));
        let (fit, variance) = (&solved.plain.eq1, solved.variance());
        let unit = fit.unit_covariance;
        let value = |value: f64, i: usize, factor: f64| Value {
            value: factor * value,
            uncertainty: variance.map(|variance| factor * (variance * unit[(i, i)]).sqrt()),
        };
        let correlation = |i, j| unit[(i, j)] / (unit[(i, i)] * unit[(j, j)]).sqrt();
        let factors = [1e3, 1e3, 1.0];
        let covariance = variance.map(|variance| {
            [0, 1, 2].map(|i| [0, 1, 2].map(|j| variance * unit[(i, j)] * factors[i] * factors[j]))
        });
        let (first, last) = curve.eq1.valid;
        let [from_first, from_last] = [first, last].map(|end| (end - fit.curve.pole).abs());
        let from_range = from_first.min(from_last);
        let all = || solved.points.iter().zip(&solved.verdicts);
        let rejected = all().filter(|(_, verdict)| !verdict.kept);
        let mut report = Self {
            verdict: Verdict::of(solved, made),
            file,
            points: solved.points.len(),
            repeats: solved.repeats.clone(),
            used: all().filter(|(_, verdict)| verdict.kept).count(),
            rejected: rejected
                .map(|(point, verdict)| Rejected {
                    line: point.line,
                    x_px: point.x_px,
                    d_mm: point.d_mm,
                    off_mm: point.d_mm - 1e3 * curve.distance(point.x_px),
                    off_deviations: verdict.off,
                })
                .collect(),
            form: made.form,
            form_because: made.because.clone(),
            eq1: Parameters {
                d_mm: value(fit.curve.d, 0, 1e3),
                k_mm_px: value(fit.curve.k, 1, 1e3),
                xp_px: value(fit.curve.pole, 2, 1.0),
                correlation: [correlation(0, 1), correlation(0, 2), correlation(1, 2)],
                covariance,
            },
            pole: Pole {
                from_range_px: from_range,
                ranges_away: from_range / (last - first),
            },
            eq1_alone: Residuals::of(&solved.plain_quality, 3.0),
            curve: Residuals::of(quality, curve.freedoms()),
            range: Range {
                first_px: first,
                last_px: last,
                first_mm: 1e3 * curve.distance(first),
                last_mm: 1e3 * curve.distance(last),
            },
            table: made.knots.map(|knots| Table { knots }),
            held_within_um: made.error_um,
            weights: match solved.weights {
                Weights::Alike => "all centres alike, for want of sigma_px".into(),
                Weights::Known => "by what was given of the points' uncertainties".into(),
            },
            scatter: quality.scatter,
            surface: Surface::of(solved, curve).map(|surface| ShownSurface {
                middle_mm: 1e3 * (curve.eq1.curve.d + surface.middle),
                deviation_um: 1e6 * surface.share * surface.middle,
                known_to: surface.known_to,
                height_counts: surface.height,
            }),
            comb: comb.cloned(),
            cannot_show: Vec::new(),
            record: None,
        };
        report.cannot_show = report.limits(solved.weights);
        report
    }

    pub(super) fn add_record(&mut self, path: &Path, record: &EncodedRecord) {
        let shown = Shown::of(record);
        self.record = Some(RecordWritten {
            file: path.display().to_string(),
            bytes: shown.bytes,
            serial: shown.serial_number,
            date: shown.date,
            estimator: shown.estimator,
            black: shown.black,
        });
    }

    pub(super) fn assumes_estimator(&mut self) {
        let text = "how the centres were found: the points name no estimator, and the record takes adaptive, \
                    as the factory sets it; if it was another, give --estimator";
        self.cannot_show.push(text.into());
    }

    /// What the points cannot show.
    fn limits(&self, weights: Weights) -> Vec<String> {
        let mut limits = Vec::new();
        if self.used == 3 {
            limits.push(
                "three points lie on some eq. (1) whatever they are: there are no residuals, and nothing \
                 checks them".into(),
            );
            if weights == Weights::Alike {
                limits
                    .push("nor is there an uncertainty: give sigma_px, or take more points".into());
            }
        } else if self.points < FEWEST_TO_REJECT {
            limits.push(format!(
                "with fewer than {FEWEST_TO_REJECT} points none could be rejected, and no departure from eq. \
                 (1) be seen"
            ));
        }
        let freedom = self.used as f64 - self.curve.freedoms;
        if freedom > 0.5 && freedom < 20.0 {
            let percent = 100.0 / (2.0 * freedom).sqrt();
            limits.push(if weights == Weights::Known && freedom < FEW_FREEDOMS {
                format!(
                    "the scatter is known to {percent:.0} % only: however small it is, the uncertainties \
                     here are not less than what was given of the points makes them"
                )
            } else {
                format!(
                    "the scatter, and with it every uncertainty here, is known to {percent:.0} % only"
                )
            });
        }
        for (which, leverage) in [
            ("first", self.curve.leverage_first),
            ("last", self.curve.leverage_last),
        ] {
            if self.used > 3 && leverage > 0.5 {
                let percent = 100.0 * leverage;
                limits.push(format!(
                    "the {which} point holds the curve there: {percent:.0} % of its error is in it; take more \
                     points near that end"
                ));
            }
        }
        let always = [
            "an error that all positions share (the zero or the scale of a stage or ruler) is in the \
             calibration, and not in these figures",
            "one that neighbours share (speckle, where steps are short) makes the uncertainties too small",
        ];
        limits.extend(always.map(str::to_owned));
        limits
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let form = match self.form {
            Form::Eq1 => "eq. (1)",
            Form::Corrected => "eq. (1) with a table of smoothed residuals",
            Form::Table => "a table of smoothed distances",
        };
        let (range, eq1, pole) = (&self.range, &self.eq1, &self.pole);
        writeln!(
            f,
            "{}\n\n{}: {} points, {} used, {} rejected\n  weighted {}",
            self.verdict,
            self.file,
            self.points,
            self.used,
            self.rejected.len(),
            self.weights
        )?;
        if let Some(it) = &self.repeats {
            write_repeats(f, it)?;
        }
        writeln!(
            f,
            "  from {:.3} to {:.3} px, which are {:.3} to {:.3} mm",
            range.first_px, range.last_px, range.first_mm, range.last_mm
        )?;
        writeln!(f, "\nCalibration: {form} ({})", self.form_because)?;
        if let Some(Table { knots }) = self.table {
            writeln!(f, "  {knots} knots")?;
        }
        let [dk, dx, kx] = eq1.correlation;
        writeln!(
            f,
            "  the sensor's distances are within {:.3} um of the curve, rounding and knots included\n\n\
             Eq. (1): d = D + K/(x - xp)\n  D   {:>14} mm\n  K   {:>14} mm px\n  xp  {:>14} px\n  \
             correlation D,K {dk:+.6}  D,xp {dx:+.6}  K,xp {kx:+.6}\n  \
             the pole xp is {:.0} px from the range, {:.2} times its length\n\n\
             Residuals, um                 RMS    largest  cross-validated",
            self.held_within_um,
            eq1.d_mm,
            eq1.k_mm_px,
            eq1.xp_px,
            pole.from_range_px,
            pole.ranges_away
        )?;
        residuals(f, "eq. (1)", &self.eq1_alone)?;
        if self.form != Form::Eq1 {
            residuals(f, "smoothed", &self.curve)?;
        }
        match (self.scatter, self.weights.starts_with("all")) {
            (Some(scatter), true) => writeln!(f, "  centres scatter by {scatter:.5} px")?,
            (Some(scatter), false) => {
                let hint = match scatter > SCATTERED && self.used >= FEWEST_TO_REJECT {
                    true => ": an uncertainty was given too small, or an error not at all",
                    false => "",
                };
                writeln!(
                    f,
                    "  points scatter {scatter:.2} times as much as was given{hint}"
                )?;
            }
            (None, _) => {}
        }
        writeln!(f, "\nThe curve itself")?;
        let curve = &self.curve;
        if let (Some(rms), Some(largest)) = (curve.uncertainty_um, curve.largest_uncertainty_um) {
            writeln!(
                f,
                "  standard uncertainty over the range: RMS {rms:.2} um, largest {largest:.2} um"
            )?;
        }
        writeln!(
            f,
            "  freedoms {:.1}; leverage of the first point {:.2}, of the last {:.2}",
            curve.freedoms, curve.leverage_first, curve.leverage_last
        )?;
        if let Some(comb) = &self.comb {
            write_comb(f, comb)?;
        }
        writeln!(f, "\nThe target's surface")?;
        match &self.surface {
            Some(surface) if self.comb.is_some() => writeln!(
                f,
                "  moves all slits together by {:.1} um at {:.0} mm, which their scatter cannot show",
                surface.deviation_um, surface.middle_mm
            )?,
            None if self.comb.is_some() => writeln!(
                f,
                "  there are too few points to tell what moves all slits together: u holds their scatter"
            )?,
            Some(surface) => writeln!(
                f,
                "  moves a distance by {:.1} um +- {:.0} % at {:.0} mm, for a spot of {:.0} counts: the \
                 surface's part of u; more rows of a target at rest do not reduce it",
                surface.deviation_um,
                100.0 * surface.known_to,
                surface.middle_mm,
                surface.height_counts
            )?,
            None => writeln!(
                f,
                "  not told by these points: they have no height_counts, or there are too few; the sensor \
                 takes an estimate"
            )?,
        }
        if !self.rejected.is_empty() {
            writeln!(f, "\nRejected: off the curve that the others make")?;
            for point in &self.rejected {
                writeln!(
                    f,
                    "  line {}: {:.5} px at {:.4} mm, off by {:+.4} mm, {:.1} standard deviations",
                    point.line, point.x_px, point.d_mm, point.off_mm, point.off_deviations
                )?;
            }
        }
        writeln!(f, "\nWhat these points cannot show")?;
        for limit in &self.cannot_show {
            writeln!(f, "  {limit}")?;
        }
        if let Some(it) = &self.record {
            writeln!(
                f,
                "\n{}: {} bytes, serial {}, {}, estimator {}, black {}",
                it.file, it.bytes, it.serial, it.date, it.estimator, it.black
            )?;
        }
        Ok(())
    }
}

fn write_repeats(f: &mut fmt::Formatter<'_>, it: &Repeats) -> fmt::Result {
    writeln!(
        f,
        "  {} more points repeat a distance: the points of a distance count as one, their mean",
        it.repeats
    )?;
    if let Some((px, mm)) = it.scatter_px.zip(it.scatter_mm) {
        writeln!(
            f,
            "  repeated points scatter by {px:.4} px, which are {mm:.4} mm: noise"
        )?;
    }
    if let Some((mm, u)) = it.backlash_mm {
        writeln!(
            f,
            "  on the way up, the centres stand for {mm:+.4} +- {u:.4} mm more than on the way down: backlash"
        )?;
    }
    Ok(())
}

fn write_comb(f: &mut fmt::Formatter<'_>, comb: &FittedComb) -> fmt::Result {
    let (slits, images) = (comb.slits.len(), comb.images);
    writeln!(f, "\nThe comb: {slits} slits, {images} images")?;
    if comb.rejected > 0 {
        writeln!(
            f,
            "  {} images lie far from the others of their point, and do not count",
            comb.rejected
        )?;
    }
    writeln!(
        f,
        "  by the scatter of its slits, a point's centre is uncertain by {:.4} px (RMS)\n  \
         slit  place um  points  degree  correction px  residual px",
        comb.scatter_px
    )?;
    for (slit, number) in comb.slits.iter().zip(1..) {
        let degree = slit.degree.map_or("none".to_owned(), |it| it.to_string());
        writeln!(
            f,
            "  {number:>4}  {:>8.0}  {:>6}  {degree:>6}  {:>+13.4}  {:>11.4}",
            slit.place_um, slit.points, slit.correction_px, slit.residual_px
        )?;
    }
    Ok(())
}

fn residuals(f: &mut fmt::Formatter<'_>, name: &str, of: &Residuals) -> fmt::Result {
    let cross_validated = of.cross_validated_um.map(|um| format!("{um:.3}"));
    let cross_validated = cross_validated.unwrap_or("none".to_owned());
    writeln!(
        f,
        "  {name:<21} {:>10.3} {:>10.3} {cross_validated:>16}",
        of.rms_um, of.largest_um
    )
}

impl fmt::Display for Value {
    /// With as many digits as its uncertainty gives it two of.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { value, uncertainty } = self;
        f.pad(&match uncertainty {
            Some(uncertainty) if *uncertainty > 0.0 && uncertainty.is_finite() => {
                let digits = (1.0 - uncertainty.log10().floor()).clamp(0.0, 9.0) as usize;
                format!("{value:.digits$} +- {uncertainty:.digits$}")
            }
            _ => format!("{value:.4}"),
        })
    }
}
