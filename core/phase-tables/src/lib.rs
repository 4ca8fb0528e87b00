//! The design, in f64, of slitrange's phase tables: the integer weights with which the firmware finds the
//! centre of a spot to a fraction of a pixel.
//!
//! A table holds, for each of a few sub-pixel phases of the spot, three rows of weights. Their inner products
//! with the counts around the spot are
//!
//! * the **score**, which is zero where the spot is centred on the phase, and otherwise proportional to how
//!   far it is;
//! * the **slope** of the score, so that score / slope is the distance in pixels, whatever the amplitude;
//! * the **stretch**, so that stretch / slope says how much wider the spot is than the table's width.
//!
//! Every row of weights sums to zero exactly, so the black level drops out bit for bit.
//!
//! [`set`] designs a set; [`design`] makes the weights, [`Table::quantise`] makes integers of them, and
//! [`rust_source`] writes them for the firmware. The core's `centre::tables` is the reader.
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::cast_possible_truncation))]
#![cfg_attr(not(test), warn(clippy::cast_sign_loss, clippy::unwrap_used))]

mod design;
mod quantise;

pub use design::{Background, Profile, Shape, Table, design, gaussian, slit};
pub use quantise::{IntegerTable, LARGEST_SAMPLE, rust_source};

/// The widths of a set of tables in pixels: a geometric series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Widths {
    /// The narrowest width.
    pub narrowest: f64,
    /// Ratio of each width to the one before.
    pub ratio: f64,
    /// Number of widths.
    pub count: usize,
    /// Sub-pixel phases in a width: the narrower the spot, the smaller the range in pixels over which score /
    /// slope is nearly straight.
    pub phases: f64,
}

/// Widths for the weights that serve every kind of noise: 0.79 to 11.66 pixels. Such weights are the best for
/// no kind of noise, so they lose or gain with the spot's width in first order: 4 % to either side is what
/// 1.11 of the bound leaves, with what chance adds. Wider spots are summed in blocks of 2, 4, 8, 16 pixels;
/// with five samples or more a sigma that costs less than half a per cent.
pub const FINE: Widths = Widths {
    narrowest: 0.79,
    ratio: 1.085,
    count: 34,
    phases: 3.0,
};

/// Widths for weights that are the best for the noise they serve: 0.86 to 11.04 pixels. What they lose with
/// the spot's width is of second order: at most 0.8 % within 9.5 % to either side.
pub const COARSE: Widths = Widths {
    narrowest: 0.86,
    ratio: 1.2,
    count: 15,
    phases: 4.0,
};

/// The purpose of a set of tables.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// r, the read noise's variance over the shot noise's at the peak; infinity gives least squares.
    pub noise_ratio: f64,
    /// The background under the spot.
    pub background: Background,
    /// The widths of the tables.
    pub widths: Widths,
}

/// One set for every row: in any mix of read noise and shot noise at most 1.08 and 1.09 of the bound, the
/// minimax, where the width is right.
pub const DEFAULT: Plan = Plan {
    noise_ratio: 0.23,
    background: Background::Level,
    widths: FINE,
};

/// Least squares, the best for read noise alone.
pub const LEAST_SQUARES: Plan = Plan {
    noise_ratio: f64::INFINITY,
    ..DEFAULT
};

/// Weights for the diffraction pattern of a slit. They are close to those of an unweighted fit of eq. (6): a
/// side lobe weighs 1.5 times as much as the top. With the noise ratio of [`DEFAULT`], a side lobe would
/// weigh 4.5 times as much. That ratio gains 10 % in shot noise on the pattern of a point. But its centre
/// lies further from the fit's than the centre of [`DEFAULT`] does, as soon as a laser spot blurs the
/// pattern.
pub const FRAUNHOFER: Plan = Plan {
    noise_ratio: 2.0,
    ..DEFAULT
};

/// Weights for a spot that speckle makes lopsided. They ignore a tilt within four widths, and most of what
/// light on one side of the slit does to a spot looks like such a tilt. In noise their error is 8 % (read
/// noise) to 25 % (shot noise) larger than that of the best weights.
pub const LOPSIDED: Plan = Plan {
    noise_ratio: 2.0,
    background: Background::Tilted,
    widths: COARSE,
};

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a few times a width, above 0: `as` cuts off"
)]
impl Plan {
    /// Half of the window in pixels for a width, with up to one more pixel for the phase. Beyond 4 sigma a
    /// window gains less than 0.1 % in white noise. Where shot noise dominates, the flanks weigh more. Only
    /// the pixels beside a spot tell a tilt from a spot that moved. But light on one side of the slit looks
    /// like a tilt only near the spot.
    pub fn half_width(&self, width: f64) -> usize {
        let reach = match self.background {
            Background::Level if self.noise_ratio > 0.1 => 4.0,
            Background::Level => 4.5,
            Background::Tilted if self.noise_ratio > 1.0 => 4.0,
            Background::Tilted => 5.0,
        };
        (reach * width + 1.0) as usize
    }

    /// The shape of a width's table.
    pub fn shape(&self, width: f64) -> Shape {
        Shape {
            width,
            half_width: self.half_width(width),
            phases: (self.widths.phases / width).ceil() as usize,
        }
    }
}

/// The tables of a profile for every width of a plan.
pub fn set(profile: Profile<'_>, plan: Plan) -> Vec<IntegerTable> {
    (0..)
        .take(plan.widths.count)
        .map(|i| {
            let shape = plan.shape(plan.widths.narrowest * plan.widths.ratio.powi(i));
            design(profile, shape, plan.noise_ratio, plan.background).quantise()
        })
        .collect()
}
