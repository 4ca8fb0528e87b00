//! The vertex of a parabola through the highest pixel and its two neighbours, and the same through the logarithms of their
//! counts, where a gaussian is a parabola.
//!
//! With values l at -1, 0, 1 the vertex is at d = N / 2D, N = l(1) - l(-1), D = 2 l(0) - l(1) - l(-1). Its derivatives by the
//! three values are (1 + 2d)/2D, -4d/2D and -(1 - 2d)/2D up to sign, so
//!
//! u^2 = (((1 + 2d)/2)^2 v(1) + 4 d^2 v(0) + ((1 - 2d)/2)^2 v(-1)) / D^2,
//!
//! with v the values' variances: noise^2 + g y' for counts y' above the level, and that over y'^2 for their logarithms. In
//! white noise and averaged over d it is (noise / D)^2. A spot's D falls with the square of its width, to A / sigma^2 for
//! wide ones: the uncertainty is 0.94 sigma^1.5 times the bound, because three pixels are all that is used.
//!
//! In more noise than that, u near a pixel, the highest pixel is not the one at the top. The choice makes the measured D
//! larger than the spot's, so for spots of `WIDE` pixels or more the D of a gaussian of that width stands in
//! the uncertainty. But a pixel at a distance a is lower by D a^2 / 2, so that noise moves the choice by the square root of
//! noise / D only: by sqrt(`WANDER` u) root mean square, as measured for widths of 4 to 30. The smaller of the two is claimed.
//!
//! A parabola is not a gaussian: narrow spots are found too near to the highest pixel's middle, by up to 0.064 pixel (width
//! 0.8), 0.031 (1.2), 0.012 (2), falling as 1 / width^2. Averaged over the phases that is in the uncertainty too. The logarithms
//! have no such error, but for what the pixels' own width makes (0.0005 at 0.8). Where a neighbour has less than a sixteenth of the
//! highest pixel's light the logarithm of its noise would decide, and the plain parabola is taken.

use crate::centre::half_width;
use crate::centre::plausible::{certain_in_noise, on_the_row, unsaturated};
use crate::centre::{RowCentre, WidthClass};
use crate::numeric;
use crate::fault::Fault;
use crate::row::{Geometry, Row};
use crate::spot::Spot;
use crate::units::{Counts, Pixels};

/// The width from which a spot's curvature is told better by its width than by three pixels.
const WIDE: f32 = 1.8;

/// Square of how far noise moves the highest pixel, over noise / D.
const WANDER: f32 = 0.67;

/// Error of a parabola through a gaussian, root mean square over the phases, in pixels times width squared.
const NO_GAUSSIAN: f32 = 0.033;

/// The least light of a pixel whose logarithm is taken, over the highest pixel's.
const LEAST_LIGHT: f32 = 1.0 / 16.0;

/// The vertex of a parabola through the counts.
///
/// # Errors
/// As [`crate::centre::centre`].
pub fn parabola(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    centre(row, spot, before, geometry, Scale::Counts)
}

/// The vertex of a parabola through the logarithms of the counts above the black level.
///
/// # Errors
/// As [`crate::centre::centre`].
pub fn log_parabola(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    centre(row, spot, before, geometry, Scale::Logarithms)
}

/// What the parabola goes through.
#[derive(Clone, Copy, PartialEq)]
enum Scale {
    Counts,
    Logarithms,
}

fn centre(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    scale: Scale,
) -> Result<RowCentre, Fault> {
    let light = row.light();
    let start = on_the_row(light, spot)?;
    let width = half_width::width(light, spot, before)?;
    unsaturated(row, start, width, geometry)?;
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
    let at = Pixels::from_bits(numeric::add_i32(
        numeric::mul_i32(highest, 1 << Pixels::FRACTION),
        Pixels::from_f32(vertex.place).to_bits(),
    ));
    // Of a spot that the sensor's edge cuts the highest pixel may be one that noise makes so.
    let to_the_end = (light.len() as f32 - 1.0) - at.to_f32();
    if at.to_f32() < width || to_the_end < width {
        return Err(Fault::SpotAtEdge { centre: at });
    }
    unsaturated(row, at, width, geometry)?;
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
    certain_in_noise(amplitude, uncertainty, width, spot.background.noise)?;
    Ok(RowCentre {
        centre: at,
        uncertainty: Pixels::from_f32(uncertainty),
        amplitude: Counts::from_f32(amplitude),
        width: Pixels::from_f32(half_width::follow(light, spot, at, width)),
        class: WidthClass::default(),
        misfit: false,
    })
}

/// The highest pixel within a block of the spot's centre, and the counts of its left neighbour, of itself, and of its right
/// neighbour. `None` where it has not both.
fn highest(light: &[u16], spot: &Spot) -> Option<(i32, [u16; 3])> {
    let block = 1usize << spot.block_log2.min(7);
    let first = spot.centre.saturating_sub(block);
    let near = light.get(first..)?;
    let near = near.get(..2 * block + 1).unwrap_or(near);
    let (mut place, mut top) = (0, 0);
    for (i, &count) in near.iter().enumerate() {
        if count > top {
            (place, top) = (i, count);
        }
    }
    let highest = first.saturating_add(place);
    let counts = light.get(highest.checked_sub(1)?..)?.first_chunk()?;
    Some((i32::try_from(highest).ok()?, *counts))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_found_exactly() {
        // 10 - 2 (x - 0.25)^2
        let at = |x: f32| 10.0 - 2.0 * (x - 0.25) * (x - 0.25);
        let vertex = Vertex::of([at(-1.0), at(0.0), at(1.0)], [1.0; 3], None).expect("a vertex");
        assert_eq!((vertex.place, vertex.value), (0.25, 10.0));
        // D = 4, and 1/2 + 6 d^2 of the variance.
        assert_eq!(vertex.uncertainty, libm::sqrtf(0.5 + 6.0 / 16.0) / 4.0);
    }

    /// The derivatives by each value, against differences.
    #[test]
    fn the_uncertainty_is_the_propagated_one() {
        let values = [3.0, 9.0, 6.0];
        let place = |values| Vertex::of(values, [0.0; 3], None).expect("a vertex").place;
        for i in 0..3 {
            let (mut more, mut less, mut variances) = (values, values, [0.0; 3]);
            more[i] += 0.01;
            less[i] -= 0.01;
            variances[i] = 4.0;
            let slope = (place(more) - place(less)) / 0.02;
            let vertex = Vertex::of(values, variances, None).expect("a vertex");
            assert!(
                (vertex.uncertainty / (2.0 * slope.abs()) - 1.0).abs() < 1e-3,
                "{i}"
            );
        }
    }

    #[test]
    fn what_has_no_top_has_no_vertex() {
        for values in [
            [1.0, 1.0, 1.0],
            [1.0, 2.0, 3.0],
            [3.0, 1.0, 3.0],
            [f32::NAN; 3],
        ] {
            assert!(Vertex::of(values, [1.0; 3], None).is_none());
        }
    }
}
