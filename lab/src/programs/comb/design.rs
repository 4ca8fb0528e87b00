//! Other masks and laser spots beside the default: what number, gaps and width of the slits and the laser's
//! spot trade against each other.

use figures::axes::{self, Axis, Scale, panel};
use figures::dark::BLUE;
use plotters::prelude::*;
use rand::seq::SliceRandom as _;
use slitrange::frame::comb::{self, Maximum, NOMINAL_PLACES_UM, SLIT_WIDTH_UM, SlitMap, assign};
use statistics::least_and_most;

use crate::comb::{Mask, with_speckle, with_width};
use crate::prelude::*;
use crate::programs::comb::tolerances::DISTANCE;
use crate::programs::comb::{Outcome, bar, theory};
use crate::table;

pub const FIGURE: &str = "docs/figures/comb-design.svg";

/// The image of any slit stays so far from the ends of the row, in pixels: its half width at the foot.
const MARGIN: f64 = 28.0;

/// Random rows on which peaks are given to slits.
const RANDOM_ROWS: u64 = 20_000;

/// RMS displacement of a peak in pixels: speckle of a 1 mm spot on metal (2.2) and the search (1).
const SCATTER: f64 = 2.4;

#[derive(Clone, Debug)]
struct Design {
    places_um: Vec<i32>,
    width_um: i32,
    /// The spot's 1/e^2 diameter in metres.
    spot: f64,
}

impl Design {
    fn nominal() -> Self {
        Self {
            places_um: NOMINAL_PLACES_UM.to_vec(),
            width_um: SLIT_WIDTH_UM,
            spot: 1e-3,
        }
    }

    /// The nominal gaps times a factor, from the middle of the mask.
    fn stretched(factor: f64) -> Self {
        let places = NOMINAL_PLACES_UM.map(|um| (factor * f64::from(um)).round() as i32);
        with(Self::nominal(), |it| it.places_um = places.to_vec())
    }

    fn fewer(count: usize) -> Self {
        let first = (NOMINAL_PLACES_UM.len() - count) / 2;
        with(Self::nominal(), |it| {
            it.places_um = NOMINAL_PLACES_UM[first..first + count].to_vec()
        })
    }

    /// In millimetres.
    fn smallest_gap(&self) -> f64 {
        let gaps = self.places_um.windows(2).map(|two| two[1] - two[0]);
        1e-3 * f64::from(gaps.min().unwrap_or(0))
    }

    /// The RMS error of independent images on metal, in micrometres.
    fn theory(&self) -> f64 {
        1e6 * theory::comb(DISTANCE, self.spot, 1.0, self.places_um.len())
    }

    /// The distances at which the images of all slits are on the row, in metres. `None` if there are none.
    fn range(&self) -> Option<[f64; 2]> {
        let optics = Optics::nominal();
        let pixels = sensor_heads::tcd1304dg().light.len() as f64;
        let (mut near, mut far) = (0.0f64, f64::INFINITY);
        for &um in &self.places_um {
            let slit = optics.behind(1e-6 * f64::from(um));
            // Light from beyond infinity has a distance below zero.
            let ends = [MARGIN, pixels - 1.0 - MARGIN].map(|centre| match slit.distance(centre) {
                distance if distance > 0.0 => distance,
                _ => f64::INFINITY,
            });
            near = near.max(ends[0].min(ends[1]));
            far = far.min(ends[0].max(ends[1]));
        }
        (near < far).then_some([near, far])
    }

    /// Shares of random rows that get wrong slits without a flag, and that are a fault: up to half of the
    /// slits have no peak, and one peak is false.
    fn random_rows(&self) -> Option<[f64; 2]> {
        let maps = self.places_um.iter().map(|&um| SlitMap::nominal(um));
        let comb = comb::Comb::new(&maps.collect::<Vec<_>>())?;
        let of_row = |row: u64| {
            let mut random = ChaCha8Rng::seed_from_u64(5);
            random.set_stream(row);
            let x0 = random.random_range(1191.0..2654.0);
            let mut slits: Vec<&SlitMap> = comb.slits().iter().collect();
            slits.shuffle(&mut random);
            let missing = random.random_range(0..=slits.len() / 2);
            let peak = |place: f64| Maximum {
                place: place as f32,
                height: Counts::from_int(1000),
            };
            let mut peaks: Vec<Maximum> = (slits[missing..].iter())
                .map(|slit| {
                    let normal: f64 = StandardNormal.sample(&mut random);
                    peak(slit.from_axis(Pixels::from_f32(x0)).to_f64() + SCATTER * normal)
                })
                .collect();
            peaks.push(peak(random.random_range(0.0..3648.0)));
            match assign(&peaks, &comb) {
                Ok(found) => [u64::from((found.x0.to_f32() - x0).abs() > 6.0), 0],
                Err(_) => [0, 1],
            }
        };
        let sums = (0..RANDOM_ROWS)
            .into_par_iter()
            .map(of_row)
            .reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        Some(sums.map(|count| count as f64 / RANDOM_ROWS as f64))
    }
}

pub struct Variant {
    name: String,
    /// The number of the group: slits, gaps, width, spot.
    group: usize,
    design: Design,
    outcome: Outcome,
    random: [f64; 2],
}

/// The groups, and the values on the axis of the figure.
const GROUPS: [&str; 4] = [
    "slits",
    "smallest gap, mm",
    "width of a slit, um",
    "laser spot, mm",
];

fn designs() -> Vec<(String, usize, Design)> {
    let mut all = vec![];
    for count in [8, 13, 16] {
        all.push((format!("{count} slits"), 0, Design::fewer(count)));
    }
    for factor in [0.75, 1.0, 1.25] {
        all.push((format!("gaps × {factor}"), 1, Design::stretched(factor)));
    }
    for width_um in [100, 200, 300] {
        let mut design = Design::nominal();
        design.width_um = width_um;
        all.push((format!("width {width_um} um"), 2, design));
    }
    for spot in [0.4e-3, 0.5e-3, 1e-3, 2e-3] {
        let mut design = Design::nominal();
        design.spot = spot;
        all.push((format!("spot {} mm", 1e3 * spot), 3, design));
    }
    all
}

/// Reads surfaces of metal at 0.8 m with each design.
pub fn measure(base: &Scene, rows: u16, surfaces: u64) -> Result<Vec<Variant>> {
    let designs = designs();
    let progress = bar(designs.len() as u64 * surfaces)?;
    let mut variants = vec![];
    for (name, group, design) in designs {
        progress.set_message(name.clone());
        let mask = Mask::new(&design.places_um, design.width_um).context("a comb")?;
        // The scene's spot belongs to the nominal width, so that another width has another height.
        let scene = with_speckle(base, design.spot, 1);
        let scene = with_width(scene, 1e-6 * f64::from(SLIT_WIDTH_UM));
        let outcome = Outcome::measure(&scene, [DISTANCE; 2], &mask, rows, surfaces);
        progress.inc(surfaces);
        variants.push(Variant {
            name,
            group,
            random: design.random_rows().context("a comb")?,
            outcome,
            design,
        });
    }
    Ok(variants)
}

pub fn report(variants: &[Variant]) -> String {
    let head = "differs from the default | smallest gap, mm | RMS error | theory | median u | within 2u | faults \
                | height | all images on the row, m | random rows: faults | wrong";
    let rows = variants.iter().map(|it| {
        let summary = &it.outcome.summary;
        let range = match it.design.range() {
            Some([near, far]) => format!("{near:.2} to {far:.2}"),
            None => "nowhere".into(),
        };
        vec![
            it.name.clone(),
            format!("{:.2}", it.design.smallest_gap()),
            format!("{:.0}", summary.rms),
            format!("{:.0}", it.design.theory()),
            format!("{:.0}", summary.median_u),
            format!("{:.1} %", 100.0 * summary.within[1]),
            it.outcome.faults(),
            format!("{:.0}", it.outcome.height),
            range,
            format!("{:.2} %", 100.0 * it.random[1]),
            format!("{:.3} %", 100.0 * it.random[0]),
        ]
    });
    let table = table::of(head, rows);
    let surfaces = variants.first().map_or(0, |it| {
        it.outcome.summary.count + it.outcome.faults.values().sum::<usize>()
    });
    let own_error = 100.0 / (2.0 * surfaces as f64).sqrt();
    format!(
        "Simulated on a PC: metal at {DISTANCE} m, a laser of a single wavelength, {surfaces} surfaces, so \
         that an RMS error is known to {own_error:.0} %. Errors and u in um. Theory: independent images. \
         Height: the mean of the images in counts. Random rows: {RANDOM_ROWS} rows with up to half of the \
         images missing and one false.\n\n{table}"
    )
}

pub fn draw(variants: &[Variant], path: &Path) -> Result<()> {
    let root = axes::figure(path, 760)?;
    for ((group, name), area) in (0..).zip(GROUPS).zip(root.split_evenly((2, 2))) {
        let value = |it: &Variant| match group {
            0 => it.design.places_um.len() as f64,
            1 => it.design.smallest_gap(),
            2 => f64::from(it.design.width_um),
            _ => 1e3 * it.design.spot,
        };
        let of_group: Vec<&Variant> = variants.iter().filter(|it| it.group == group).collect();
        let ticks: Vec<f64> = of_group.iter().map(|it| value(it)).collect();
        let (least, most) = least_and_most(&ticks);
        let range = (0.85 * least, 1.15 * most);
        let x = Axis::new(Scale::Log, range, name, &ticks, |it| {
            format!("{}", (100.0 * it).round() / 100.0)
        });
        let y = Axis::log((40.0, 400.0), "RMS error, um", &[50.0, 100.0, 200.0, 300.0]);
        let mut chart = panel(&area, "", 20, &x, &y)?;
        let points = |of: &dyn Fn(&Variant) -> f64| -> Vec<(f64, f64)> {
            of_group.iter().map(|it| (value(it), of(it))).collect()
        };
        let errors = points(&|it| it.outcome.summary.rms);
        let theory = points(&|it| it.design.theory());
        chart.draw_series(DashedLineSeries::new(theory, 8, 6, BLACK.stroke_width(1)))?;
        chart.draw_series(LineSeries::new(errors.clone(), BLUE.stroke_width(2)))?;
        let dots = errors.into_iter();
        chart.draw_series(dots.map(|at| Circle::new(at, 5, BLUE.filled())))?;
    }
    Ok(root.present()?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::programs::comb::tolerances::RANGE;

    #[test]
    fn the_default_comb_is_on_the_row_over_the_whole_range() {
        for (name, _, design) in designs() {
            println!("{name}: {:?}", design.range());
        }
        let [near, far] = Design::nominal().range().expect("a range");
        assert!(near < RANGE[0] && far > RANGE[1]);
    }
}
