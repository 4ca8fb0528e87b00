//! The vertex of a parabola through the highest pixel and its two neighbours, or through the logarithms of
//! their counts, where a gaussian is a parabola.
//!
//! With values l at -1, 0, 1 the vertex is at d = N / 2D, N = l(1) - l(-1), D = 2 l(0) - l(1) - l(-1). With v
//! the values' variances (noise^2 + g y' for counts y' above the level, and that over y'^2 for their
//! logarithms)
//!
//! u^2 = (((1 + 2d)/2)^2 v(1) + 4 d^2 v(0) + ((1 - 2d)/2)^2 v(-1)) / D^2.
//!
//! For wide spots this is 0.94 sigma^1.5 times the bound, because only three pixels count. The highest pixel
//! of a wide spot is not the one at the top, and its choice makes the measured D larger than the spot's. So
//! from `WIDE` pixels on the D of a gaussian of that width stands in u, and u is at most sqrt(`WANDER` u),
//! which is how far noise moves the choice (measured, widths of 4 to 30).
//!
//! A parabola is not a gaussian: the bias is up to 0.064 pixel (width 0.8), 0.031 (1.2), 0.012 (2), and falls
//! as 1 / width^2. Its mean over the phases is in u. Logarithms have no such bias. Where a neighbour has less
//! than a sixteenth of the highest pixel's light, the noise of its logarithm would decide, and the plain
//! parabola is taken.

use slitrange::base::fault::Fault;
use slitrange::base::units::{Counts, Pixels};
use slitrange::centre::half_width;
use slitrange::centre::plausible::{check_saturation, position_on_row};
use slitrange::centre::{RowCentre, WidthClass};
use slitrange::row::{Geometry, Light, Row};
use slitrange::spot::Spot;

use super::check_uncertainty_in_noise;

/// The width from which a spot's curvature is told better by its width than by three pixels.
const WIDE: f32 = 1.8;

/// Square of how far noise moves the highest pixel, over noise / D.
const WANDER: f32 = 0.67;

/// Error of a parabola through a gaussian, root mean square over the phases, in pixels times width squared.
const NO_GAUSSIAN: f32 = 0.033;

/// The least light of a pixel whose logarithm is taken, over the highest pixel's.
const LEAST_LIGHT: f32 = 1.0 / 16.0;

/// What the parabola goes through.
#[derive(Clone, Copy, PartialEq)]
pub enum Scale {
    /// The counts.
    Counts,
    /// The logarithms of the counts above the black level.
    Logarithms,
}

/// The vertex of the parabola.
///
/// # Errors
/// See [`slitrange::centre::centre`].
pub fn centre(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    scale: Scale,
) -> Result<RowCentre, Fault> {
    let light = row.light();
    let start = position_on_row(light, spot)?;
    let width = half_width::width(light, spot, before)?;
    check_saturation(row, start, width)?;
    let level = Counts::from_bits(spot.background.level_bits()).to_f32();
    let (highest, counts) = highest(light, spot).ok_or(Fault::SpotAtEdge { centre: start })?;
    let heights = counts.map(|count| f32::from(count) - level);
    let [left, top, right] = heights;
    let (noise, shot) = spot.background.variances(geometry);
    let variances = heights.map(|height| noise + shot * height.max(0.0));
    let logarithms = scale == Scale::Logarithms && left.min(right) > LEAST_LIGHT * top;
    let (values, variances) = if logarithms {
        let [a, b, c] = variances;
        (
            heights.map(libm::logf),
            [a / (left * left), b / (top * top), c / (right * right)],
        )
    } else {
        (heights, variances)
    };
    // A gaussian's curvature at its top, with the pixel's own width: of its logarithm, or times its height.
    let expected = 1.0 / (width * width + 1.0 / 12.0) * if logarithms { 1.0 } else { top };
    let vertex =
        Vertex::of(values, variances, (width >= WIDE).then_some(expected)).ok_or(spot.no_spot())?;
    // The highest pixel is below 4096, and the vertex within half a pixel of it.
    let at = Pixels::from_bits(
        highest * (1 << Pixels::FRACTION) + Pixels::from_f32(vertex.place).to_bits(),
    );
    // Of a spot that the sensor's edge cuts the highest pixel may be one that noise makes so.
    let to_the_end = (light.len() as f32 - 1.0) - at.to_f32();
    if at.to_f32() < width || to_the_end < width {
        return Err(Fault::SpotAtEdge { centre: at });
    }
    check_saturation(row, at, width)?;
    let amplitude = if logarithms {
        libm::expf(vertex.value)
    } else {
        vertex.value
    };
    let shape = if logarithms {
        0.0
    } else {
        NO_GAUSSIAN / (width * width)
    };
    let noise = vertex.uncertainty * vertex.uncertainty.min(WANDER);
    let uncertainty = dual_mac::square_root(noise + shape * shape);
    check_uncertainty_in_noise(amplitude, uncertainty, width, spot.background.noise)?;
    Ok(RowCentre {
        centre: at,
        uncertainty: Pixels::from_f32(uncertainty),
        amplitude: Counts::from_f32(amplitude),
        width: Pixels::from_f32(half_width::follow(light, spot, at, width)),
        class: WidthClass::default(),
        shape: Default::default(),
        misfit: false,
    })
}

/// The highest pixel within a block of the spot's centre, and the counts of its left neighbour, of itself,
/// and of its right neighbour. `None` where it has not both.
fn highest(light: Light<'_>, spot: &Spot) -> Option<(i32, [u16; 3])> {
    let block = 1usize << spot.block_log2.min(7);
    let first = spot.centre.saturating_sub(block);
    let near = light.slice(first..)?;
    let near = near.slice(..2 * block + 1).unwrap_or(near);
    let (mut place, mut top) = (0, 0);
    for (i, count) in near.iter().enumerate() {
        if count > top {
            (place, top) = (i, count);
        }
    }
    let highest = first.saturating_add(place);
    let counts = light.slice(highest.checked_sub(1)?..)?.chunks().next()?;
    Some((i32::try_from(highest).ok()?, counts))
}

/// A parabola's vertex.
struct Vertex {
    /// Its place, within half a pixel of the middle one.
    place: f32,
    value: f32,
    uncertainty: f32,
}

impl Vertex {
    /// Of the parabola through three values, their variances being known, and perhaps D.
    /// `None` where the middle one is not the highest.
    fn of(values: [f32; 3], variances: [f32; 3], known: Option<f32>) -> Option<Self> {
        let [left, top, right] = values;
        let (rise, curvature) = (right - left, 2.0 * top - left - right);
        let place = rise / (2.0 * curvature);
        // Half a pixel, and rounding.
        if !(curvature > 0.0 && place.abs() < 0.501) {
            return None;
        }
        let (by_right, by_left) = (0.5 + place, 0.5 - place);
        let by_top = 2.0 * place;
        let [left, middle, right] = variances;
        let variance =
            by_right * by_right * right + by_top * by_top * middle + by_left * by_left * left;
        Some(Self {
            place,
            value: top + 0.25 * rise * place,
            uncertainty: dual_mac::square_root(variance) / known.unwrap_or(curvature),
        })
    }
}
