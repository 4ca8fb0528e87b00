//! What one would use instead: the crate `levenberg-marquardt` on eq. (5), in f32 and in f64.

use cost_on_chip::inputs;
use cost_on_chip::methods::Method;
use cost_on_chip::rows::{self, PIXELS, ROWS, Turn};
use embedded_alloc::LlffHeap;
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{Const, OMatrix, OVector, Owned, U4};

use super::board::let_the_log_out;
use super::counter::{self, Cost, Counted};

/// `levenberg-marquardt` links `alloc`, which asks for a heap. It takes none of it for sizes that are known.
#[global_allocator]
static NO_HEAP: LlffHeap = LlffHeap::empty();

/// Pixels that are fitted: the paper takes 128, and nalgebra knows the sizes up to 127.
const FITTED: usize = 127;
type Fitted = Const<FITTED>;

/// The width of the spot, the paper's.
const WIDTH: f32 = 10.5;

/// The pixels and where the fit starts, as it is known from the row before.
struct Input {
    /// Counts.
    pixels: [u16; FITTED],
    /// Amplitude, centre in pixels from the first, s = 1/(sqrt(2) sigma), and black level.
    start: [f32; 4],
}

/// Counts fits with the crate's default tolerances on [`ROWS`] rows.
pub fn measure() {
    measure_one("levenberg-marquardt-f32", peer_levenberg_marquardt_f32);
    measure_one("levenberg-marquardt-f64", peer_levenberg_marquardt_f64);
}

/// A fit starts where the default estimator found the spot of a target on the move, in the row before.
fn measure_one(name: &str, peer: Counted<Input, f64>) {
    let geometry = rows::geometry();
    let (mut before, mut now) = ([0; PIXELS], [0; PIXELS]);
    let mut costs = [Cost::default(); ROWS];
    for (row, cost) in costs.iter_mut().enumerate() {
        rows::light(WIDTH, row, Turn::BeforeMoved, &mut before);
        rows::light(WIDTH, row, Turn::Now, &mut now);
        let searched = defmt::unwrap!(inputs::searched(&before).ok());
        let now_searched = defmt::unwrap!(inputs::searched(&now).ok());
        let level = now_searched.spot.background.level;
        let known = inputs::input(Method::default(), &searched, now_searched, &geometry);
        let known = defmt::unwrap!(known.before);
        let centre = known.centre.to_f32();
        let first = centre as usize - FITTED / 2;
        let input = Input {
            pixels: defmt::unwrap!(now[first..][..FITTED].try_into().ok()),
            start: [
                known.amplitude.to_f32(),
                centre - first as f32,
                core::f32::consts::FRAC_1_SQRT_2 / known.width.to_f32(),
                level.to_f32(),
            ],
        };
        let mut found = 0.0;
        *cost = counter::count(peer, &input, &mut found);
        defmt::println!(
            "peer-row {} number {} centre {}",
            name,
            row,
            found + first as f64
        );
        let_the_log_out();
    }
    counter::print("peer", name, ("rows", ROWS as f32), costs);
}

/// Eq. (5): a exp(-(s (x - x0))^2) + black level.
struct Gaussian<F: nalgebra::Scalar> {
    counts: [F; FITTED],
    parameters: OVector<F, U4>,
}

/// Implements the fit and the function that is counted for a type of numbers. Each type has its own code, as
/// a user of the crate would write it.
macro_rules! peer {
    ($function:ident: $number:ident, $exp:path) => {
        impl LeastSquaresProblem<$number, Fitted, U4> for Gaussian<$number> {
            type ParameterStorage = Owned<$number, U4>;
            type ResidualStorage = Owned<$number, Fitted>;
            type JacobianStorage = Owned<$number, Fitted, U4>;

            fn set_params(&mut self, parameters: &OVector<$number, U4>) {
                self.parameters = *parameters;
            }

            fn params(&self) -> OVector<$number, U4> {
                self.parameters
            }

            fn residuals(&self) -> Option<OVector<$number, Fitted>> {
                let [a, centre, s, level] = self.parameters.into();
                Some(OVector::from_fn(|i, _| {
                    let u = s * (i as $number - centre);
                    a * $exp(-u * u) + level - self.counts[i]
                }))
            }

            fn jacobian(&self) -> Option<OMatrix<$number, Fitted, U4>> {
                let [a, centre, s, _] = self.parameters.into();
                let mut jacobian = OMatrix::<$number, Fitted, U4>::zeros();
                for (i, mut row) in jacobian.row_iter_mut().enumerate() {
                    let d = i as $number - centre;
                    let u = s * d;
                    let g = $exp(-u * u);
                    row[0] = g;
                    row[1] = 2.0 * a * g * s * u;
                    row[2] = -2.0 * a * g * u * d;
                    row[3] = 1.0;
                }
                Some(jacobian)
            }
        }

        #[inline(never)]
        #[unsafe(no_mangle)]
        extern "C" fn $function(input: &Input, centre: &mut f64) {
            let problem = Gaussian {
                counts: input.pixels.map($number::from),
                parameters: OVector::from(input.start.map($number::from)),
            };
            let (problem, _) = LevenbergMarquardt::new().minimize(problem);
            *centre = f64::from(problem.parameters[1]);
        }
    };
}

peer!(peer_levenberg_marquardt_f32: f32, libm::expf);
peer!(peer_levenberg_marquardt_f64: f64, libm::exp);
