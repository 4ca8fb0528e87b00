//! Takes the rows from which the front end is computed: in the dark, and with longer and longer exposures.

use std::io::Write;
use std::ops::Range;

use anyhow::{Context as _, Result, bail, ensure};
use slitrange::base::exposure::{Exposure, ExposureMode};
use slitrange::light::ambient::AmbientMode;
use slitrange::row::Geometry;
use slitrange_device::protocol::row_lines::{RowExposure, RowPart};
use slitrange_device::settings::Value;
use statistics::{mean, median, variance};

use super::super::answers::NoCentre;
use super::super::row::{RowAnswer, ask_row};
use super::super::session::Session;
use crate::photon_transfer::{Transfer, VARIANCE_OF_ROUNDING, dark_point, mean_row, transfer};

/// Whole rows with the laser off. Their 3648 pixels give the read noise to 0.7 %.
const DARK_ROWS: usize = 4;
/// Exposures at which the spot is looked for, in us. The longest that may be used follows.
const SEARCH_US: [u16; 5] = [10, 40, 160, 640, 2560];
/// Pixels over which a row is smoothed to find the spot: narrower than a spot, with a third of the noise.
const SMOOTHED: usize = 9;
/// The spot is found once it is so high, in counts: 60 times the noise of the smoothed row.
const HIGH: f64 = 300.0;
/// A spot must be so high at the longest exposure, in counts.
const LEAST_HIGH: f64 = 100.0;
/// The window ends where the spot has this share of its height.
const EDGE: f64 = 0.05;
/// The most pixels in the window: a row of them takes 60 ms to send.
const WIDEST: usize = 200;
/// From one exposure to the next on the way to saturation.
const STEP: f64 = 1.5;
/// The light has stopped growing if it grows by less than this share of what the exposure does.
const STOPPED: f64 = 0.3;
/// A step whose height over its exposure is at least this share of the first one's shows no saturation. The
/// noise of a height is below 1 %.
const STRAIGHT: f64 = 0.95;
/// Rows at each exposure on the way to saturation: the mean of few pixels needs no more.
const ROWS_A_STEP: usize = 3;
const ROWS_SATURATED: usize = 10;
/// A pixel is saturated for certain if it would read so many times as much without a limit.
const BEYOND: f64 = 1.3;
/// Fewest saturated pixels that show the level.
const FEWEST_SATURATED: usize = 3;
/// The longest exposure for the noise brings the spot to this share of the saturation: no noise is cut off.
const HIGHEST: f64 = 0.85;
/// Exposures for the noise.
const EXPOSURES: u32 = 12;
/// The shortest of them is a little more than this part of the longest one: dim rows tell little of the gain.
const LEAST_PART: f64 = 0.2;
/// Fewest different exposures for the noise.
const FEWEST_EXPOSURES: usize = 4;
/// Rows at each of these exposures in a pass.
const ROWS_A_PASS: usize = 20;
/// Passes through these exposures: at least, and at most.
const FEWEST_PASSES: usize = 2;
const MOST_PASSES: usize = 12;
/// The gain is then known well enough: a quarter of 5 %. r follows the root of the gain at most.
const AIM: f64 = 0.0125;
/// A gain that is not known so well is refused.
const WORST: f64 = 0.05;
/// Points that lie farther off the line, over what chance allows, are refused. Chance alone gives 0.97 to
/// 1.03 for a thousand points.
const MOST_SCATTER: f64 = 1.2;
/// What to do if the noise is not that of light.
const NOT_AT_REST: &str = "check that the target is at rest and that no lamp flickers";
/// What to do if the shortest exposure is too long.
const TOO_BRIGHT: &str = "the spot saturates at the shortest exposure: put a darker target, such as white \
                          paper, before the sensor";

/// At most so many rows may have another exposure than the one that was set: the firmware has some under way.
const ROWS_UNDER_WAY: usize = 20;

/// What the sensor showed. All counts rise with light, also if the firmware has the polarity wrong.
#[derive(Clone, Debug)]
pub struct Taken {
    /// Whether the firmware has the polarity the wrong way round.
    pub is_inverted: bool,
    /// The counts of an unlit pixel, and their standard uncertainty.
    pub black: [f64; 2],
    /// The mean of all light pixels with the laser off.
    pub dark_level: f64,
    /// For each exposure in us, the mean of the highest pixels above the dark.
    pub heights: Vec<(u16, f64)>,
    /// The count that light does not exceed, and its standard uncertainty. `None` if the light grew to the
    /// longest exposure.
    pub saturation: Option<[f64; 2]>,
    /// How the noise grows with the light.
    pub photons: Transfer,
}

/// A sensor before a target at rest.
pub struct Bench<'a, 'b> {
    session: &'a mut Session<'b>,
    limit: Exposure,
    full_scale: f64,
    is_inverted: bool,
    /// The mean of the shielded pixels of each row, as the sensor said it.
    black: Vec<f64>,
}

struct Spot {
    window: Range<usize>,
    exposure: u16,
    /// The height above the dark, in counts.
    height: f64,
}

/// The mean of the window's pixels above the dark at an exposure.
struct Step {
    exposure: u16,
    signal: Vec<f64>,
    height: f64,
}

impl<'a, 'b> Bench<'a, 'b> {
    /// Begins with a sensor whose rows have this geometry. No exposure is longer than `limit`.
    pub fn new(session: &'a mut Session<'b>, geometry: &Geometry, limit: Exposure) -> Self {
        Self {
            session,
            limit,
            full_scale: geometry.full_scale().into(),
            is_inverted: false,
            black: vec![],
        }
    }

    /// Takes all rows.
    pub fn take(mut self, output: &mut dyn Write) -> Result<Taken> {
        self.session.borrow(Value::Ambient(AmbientMode::Off))?;
        self.session.borrow(Value::Laser(false))?;
        let dark = self.rows(RowPart::Whole, RowExposure::Off, DARK_ROWS)?;
        let mut dark_rows = self.counts(&dark);
        let level = |rows: &[Vec<f64>]| mean(mean_row(rows).unwrap_or_default());
        let counts = level(&dark_rows);
        writeln!(output, "laser off: {DARK_ROWS} rows, {counts:.1} counts")?;
        self.session.borrow(Value::Laser(true))?;
        let spot = self.find_spot(&dark_rows)?;
        if self.is_inverted {
            dark_rows = self.counts(&dark);
        }
        let (first, last) = (spot.window.start, spot.window.end - 1);
        writeln!(
            output,
            "spot at pixels {first} to {last}, {:.0} counts high at {} us",
            spot.height, spot.exposure
        )?;
        let whole = mean_row(&dark_rows).unwrap_or_default();
        let in_the_dark = dark_point(&dark_rows);
        let in_the_dark = in_the_dark.context("the rows with the laser off have no pixels")?;
        let dark = whole[spot.window.clone()].to_vec();
        let dark_level = level(&dark_rows);
        let (steps, saturation) = self.raise(&spot, &dark, output)?;
        let longest = longest_for_noise(&steps, saturation, dark_level);
        let part = |step| f64::from(step) / f64::from(EXPOSURES);
        let us = |step| longest * (LEAST_PART + (1.0 - LEAST_PART) * part(step));
        let time = |step| (us(step).round() as u16).max(Exposure::SHORTEST.us());
        let mut times: Vec<u16> = (1..=EXPOSURES).map(time).collect();
        times.dedup();
        ensure!(
            times.len() >= FEWEST_EXPOSURES,
            "there are too few exposures from {} us to {longest:.0} us: put a darker target, such as white \
             paper, before the sensor, or raise `exposure limit`",
            Exposure::SHORTEST.us()
        );
        let heights = steps.iter().map(|it| (it.exposure, it.height));
        let mut heights: Vec<(u16, f64)> = heights.collect();
        // By exposure and pass, each with its own mean: a slow change from pass to pass is no noise.
        let mut series = vec![];
        let mut photons = None;
        for pass in 1..=MOST_PASSES {
            for &us in &times {
                let rows = self.exposed(&spot.window, us, ROWS_A_PASS)?;
                if pass == 1 {
                    heights.push((us, Step::new(us, &rows, &dark).height));
                }
                series.push(rows);
            }
            photons = transfer(&series, &dark, in_the_dark);
            let Some(line) = photons.as_ref().map(|photons| photons.line) else {
                continue;
            };
            let known = line.per_count_u / line.per_count;
            writeln!(
                output,
                "pass {pass}, {ROWS_A_PASS} rows at {} exposures: {:.2} electrons a count, to {:.1} %",
                times.len(),
                1.0 / line.per_count,
                100.0 * known
            )?;
            if pass >= FEWEST_PASSES && known <= AIM {
                break;
            }
        }
        let dim = || format!("the noise does not grow with the light: {NOT_AT_REST}");
        let photons = photons.with_context(dim)?;
        let line = &photons.line;
        ensure!(
            line.scatter <= MOST_SCATTER,
            "the noise of the pixels differs by {:.2} times what chance allows: {NOT_AT_REST}",
            line.scatter
        );
        ensure!(
            line.per_count_u <= WORST * line.per_count,
            "the gain is known to {:.0} % only: put a brighter target before the sensor, and shade it from \
             lamps",
            100.0 * line.per_count_u / line.per_count
        );
        Ok(Taken {
            is_inverted: self.is_inverted,
            black: self.black_level(dark_level),
            dark_level,
            heights,
            saturation,
            photons,
        })
    }

    /// Takes rows of an exposure. Rows that were exposed before it was set are left out.
    fn rows(
        &mut self,
        part: RowPart,
        exposure: RowExposure,
        count: usize,
    ) -> Result<Vec<RowAnswer>> {
        let mut rows = vec![];
        let mut others = 0;
        while rows.len() < count {
            ensure!(
                !self.session.line().pc().interrupted(),
                "ended by Ctrl-C: nothing was measured"
            );
            let row = ask_row(self.session, part)?;
            if row.exposure == exposure {
                self.black.extend(row.black);
                rows.push(row);
                continue;
            }
            others += 1;
            let why = match &row.centre {
                Err(NoCentre { fault, .. }) if row.exposure == RowExposure::Unknown => fault,
                _ => "has somebody else typed a command?",
            };
            ensure!(
                others < ROWS_UNDER_WAY,
                "the rows have an exposure of {} us, and {exposure} us was set ({why})",
                row.exposure
            );
        }
        Ok(rows)
    }

    fn rising(&self, count: f64) -> f64 {
        match self.is_inverted {
            false => count,
            true => self.full_scale - count,
        }
    }

    /// Counts that rise with light.
    fn counts(&self, rows: &[RowAnswer]) -> Vec<Vec<f64>> {
        let count = |&count: &u16| self.rising(count.into());
        let row = |row: &RowAnswer| row.counts.iter().map(count).collect();
        rows.iter().map(row).collect()
    }

    fn exposed(&mut self, window: &Range<usize>, us: u16, count: usize) -> Result<Vec<Vec<f64>>> {
        let exposure = Exposure::from_us(us);
        let exposure = exposure.with_context(|| format!("the laser cannot be on for {us} us"))?;
        let fixed = Value::Exposure(ExposureMode::Fixed(exposure));
        self.session.borrow(fixed)?;
        let part = RowPart::Range {
            // A row has at most 4096 pixels.
            first: window.start as u16,
            last: (window.end - 1) as u16,
        };
        let rows = self.rows(part, RowExposure::On(exposure), count)?;
        Ok(self.counts(&rows))
    }

    /// The mean of the shielded pixels with its u; without such pixels, the level with the laser off.
    fn black_level(&self, dark_level: f64) -> [f64; 2] {
        let levels = &self.black;
        if levels.len() < 2 {
            return [dark_level, 0.0];
        }
        let u = (variance(levels) / levels.len() as f64).sqrt();
        [self.rising(mean(levels)), u]
    }

    /// Finds the spot, and whether light raises the counts.
    fn find_spot(&mut self, dark: &[Vec<f64>]) -> Result<Spot> {
        let dark = mean_row(dark).unwrap_or_default();
        let mut brightest = 0.0f64;
        let limit = self.limit.us();
        let below = SEARCH_US.into_iter().filter(|&us| us < limit);
        for us in below.chain([limit]) {
            let whole = 0..dark.len();
            let rows = self.exposed(&whole, us, 1)?;
            let signal = Step::new(us, &rows, &dark).signal;
            // Lamps that flicker lift or lower the whole row.
            let level = median(&signal);
            let smooth = signal.windows(SMOOTHED).map(|near| mean(near) - level);
            let smooth: Vec<f64> = smooth.collect();
            let by_size = |a: &usize, b: &usize| smooth[*a].abs().total_cmp(&smooth[*b].abs());
            let Some(place) = (0..smooth.len()).max_by(by_size) else {
                bail!("the sensor's rows have {} pixels only", dark.len());
            };
            let height = smooth[place];
            brightest = brightest.max(height.abs());
            if height.abs() < if us == limit { LEAST_HIGH } else { HIGH } {
                continue;
            }
            self.is_inverted = height < 0.0;
            return Ok(Spot {
                window: window(&smooth, place, dark.len()),
                exposure: us,
                height: height.abs(),
            });
        }
        bail!(
            "the brightest place has {brightest:.0} counts at {limit} us, and {LEAST_HIGH:.0} are needed: \
             put a brighter target, such as white paper, nearer to the sensor, and check the laser"
        )
    }

    /// Raises the exposure until the light stops growing. Gives the steps and the saturation with its u.
    fn raise(
        &mut self,
        spot: &Spot,
        dark: &[f64],
        output: &mut dyn Write,
    ) -> Result<(Vec<Step>, Option<[f64; 2]>)> {
        let longest = f64::from(self.limit.us());
        let shortest = f64::from(Exposure::SHORTEST.us());
        let begin = f64::from(spot.exposure) * HIGH / spot.height;
        let mut us = begin.clamp(shortest, longest);
        let mut steps: Vec<Step> = vec![];
        loop {
            let exposure = us.round() as u16;
            let rows = self.exposed(&spot.window, exposure, ROWS_A_STEP)?;
            let step = Step::new(exposure, &rows, dark);
            let stopped = steps.last().is_some_and(|before| before.stops_at(&step));
            steps.push(step);
            if stopped {
                break;
            }
            if us >= longest {
                return Ok((steps, None));
            }
            us = (us * STEP).min(longest);
        }
        ensure!(straight(&steps).is_some(), "{TOO_BRIGHT}");
        let saturated = (2.0 * us).min(longest).round() as u16;
        let rows = self.exposed(&spot.window, saturated, ROWS_SATURATED)?;
        let level = self.saturation(&steps, saturated, &rows);
        if let Some([level, _]) = level {
            writeln!(
                output,
                "the light grows no more at {saturated} us: {level:.1} counts"
            )?;
        }
        Ok((steps, level))
    }

    /// The level, with its u, of pixels that light would lift far beyond it. `None` if there are too few.
    fn saturation(&self, steps: &[Step], us: u16, rows: &[Vec<f64>]) -> Option<[f64; 2]> {
        let highest = steps.last()?.height;
        let straight = straight(steps)?;
        let factor = f64::from(us) / f64::from(straight.exposure);
        let mean = mean_row(rows)?;
        let is_full = |signal: &f64| *signal * factor > BEYOND * highest;
        let pixels = mean.iter().zip(&straight.signal);
        let levels = pixels.filter_map(|(&level, signal)| is_full(signal).then_some(level));
        let levels: Vec<f64> = levels.collect();
        if levels.len() < FEWEST_SATURATED {
            return None;
        }
        let level = statistics::mean(&levels);
        if level >= self.full_scale - 0.5 {
            return Some([self.full_scale, 0.0]);
        }
        // Rounding may shift all of them alike, by up to half a count.
        let of_rounding = VARIANCE_OF_ROUNDING.sqrt();
        let of_scatter = (variance(&levels) / levels.len() as f64).sqrt();
        Some([level, of_scatter.hypot(of_rounding)])
    }
}

impl Step {
    fn new(exposure: u16, rows: &[Vec<f64>], dark: &[f64]) -> Self {
        let mean = mean_row(rows).unwrap_or_default();
        let above_dark = mean.iter().zip(dark).map(|(lit, dark)| lit - dark);
        let signal: Vec<f64> = above_dark.collect();
        let mut sorted = signal.clone();
        sorted.sort_by(f64::total_cmp);
        // Three pixels have less noise than the highest one alone.
        let highest = &sorted[sorted.len().saturating_sub(3)..];
        let height = highest.iter().sum::<f64>() / highest.len().max(1) as f64;
        Self {
            exposure,
            signal,
            height,
        }
    }

    /// Whether the height has grown with the exposure since the first step, but for noise.
    fn follows_exposure(&self, steps: &[Self]) -> bool {
        let rate = |step: &Self| step.height / f64::from(step.exposure);
        (steps.first()).is_some_and(|first| rate(self) >= STRAIGHT * rate(first))
    }

    /// Whether the light grew by much less than the exposure from this step to the next one.
    fn stops_at(&self, next: &Self) -> bool {
        let exposure = f64::from(next.exposure) / f64::from(self.exposure);
        next.height - self.height < STOPPED * (exposure - 1.0) * self.height
    }
}

/// The brightest step with no pixel near its limit: the height is at most 0.6 of the last one's.
fn straight(steps: &[Step]) -> Option<&Step> {
    let highest = steps.last()?.height;
    steps.iter().rfind(|step| step.height <= 0.6 * highest)
}

/// The longest exposure for the noise, in us. At this exposure the spot has [`HIGHEST`] of the saturation, or
/// less if nobody knows the saturation.
fn longest_for_noise(steps: &[Step], saturation: Option<[f64; 2]>, dark_level: f64) -> f64 {
    let us = match (saturation, straight(steps)) {
        (Some([level, _]), Some(straight)) => {
            (level - dark_level) / straight.height * f64::from(straight.exposure)
        }
        // The light may have begun to grow more slowly.
        _ => {
            let last = steps.iter().rfind(|step| step.follows_exposure(steps));
            last.map_or(0.0, |step| step.exposure.into())
        }
    };
    let most = steps.last().map_or(0.0, |step| step.exposure.into());
    (HIGHEST * us).min(most)
}

/// The pixels of the spot around a place of the smoothed row, with room on both sides.
fn window(smooth: &[f64], place: usize, pixels: usize) -> Range<usize> {
    let edge = EDGE * smooth[place];
    // Both have the sign of the spot.
    let is_lit = |&at: &usize| smooth[at] / edge > 1.0;
    let right = (place..smooth.len()).take_while(is_lit).count();
    let left = (0..place).rev().take_while(is_lit).count();
    let room = (left + right) / 3 + SMOOTHED;
    // A smoothed place is the mean of the pixels from there on.
    let middle = place + SMOOTHED / 2;
    let reach = |length: usize| (length + room).min(WIDEST / 2);
    middle.saturating_sub(reach(left))..(middle + reach(right)).min(pixels)
}
