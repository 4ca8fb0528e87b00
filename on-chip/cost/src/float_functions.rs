//! The exponential, the logarithm and the square root of f32 by the libraries that a `no_std` program would
//! take, with the arguments that the core gives them.

use micromath::F32;

/// A function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    /// The exponential.
    Exp,
    /// The natural logarithm.
    Ln,
    /// The square root.
    SquareRoot,
}

/// Where a function comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Library {
    /// The crate `libm`.
    Libm,
    /// The crate `micromath`.
    Micromath,
    /// The crate `dual-mac`: the chip's instruction VSQRT.
    DualMac,
}

/// Every function that is measured, of each library that has it, with its name in the log.
pub const ALL: [(Function, Library, &str); 7] = [
    (Function::Exp, Library::Libm, "exp-libm"),
    (Function::Exp, Library::Micromath, "exp-micromath"),
    (Function::Ln, Library::Libm, "ln-libm"),
    (Function::Ln, Library::Micromath, "ln-micromath"),
    (Function::SquareRoot, Library::Libm, "square-root-libm"),
    (
        Function::SquareRoot,
        Library::Micromath,
        "square-root-micromath",
    ),
    (
        Function::SquareRoot,
        Library::DualMac,
        "square-root-dual-mac",
    ),
];

/// Arguments of each function.
pub const ARGUMENTS: usize = 3 * WIDTHS.len() * PHASES;

/// Widths of spots in pixels.
const WIDTHS: [f32; 6] = [0.8, 1.5, 4.5, 8.6, 11.3, 18.0];

/// Places of a spot within a pixel.
const PHASES: usize = 8;

impl Function {
    /// The `i`-th of [`ARGUMENTS`] arguments, as the core has them.
    pub fn argument(self, i: usize) -> f32 {
        let part = ((i % ARGUMENTS) as f32 + 0.5) / ARGUMENTS as f32;
        match self {
            Self::Exp => exponent(i),
            Self::Ln => ratio(part),
            Self::SquareRoot => square(part),
        }
    }

    /// The value to far more digits than an f32 has.
    fn exact(self, argument: f32) -> f64 {
        let argument = f64::from(argument);
        match self {
            Self::Exp => libm::exp(argument),
            Self::Ln => libm::log(argument),
            Self::SquareRoot => libm::sqrt(argument),
        }
    }

    /// The `part` of the range of arguments over which errors are taken, from 0 to 1.
    fn place(self, part: f32) -> f32 {
        match self {
            // All of e, out to six widths.
            Self::Exp => -18.0 * part,
            Self::Ln => ratio(part),
            Self::SquareRoot => square(part),
        }
    }
}

/// A second spot over the most light of it that stays unmasked, in the check's repair: from 1 to 1000.
fn ratio(part: f32) -> f32 {
    libm::powf(1000.0, part)
}

/// Variances and squares of lengths: between these powers of two.
fn square(part: f32) -> f32 {
    libm::exp2f(80.0 * part - 40.0)
}

/// The largest error over the range of arguments. That of the exponential and of the square root is relative.
/// That of the logarithm, which goes through zero, is absolute.
pub fn largest_error(function: Function, library: Library) -> f64 {
    const PLACES: u16 = 50_000;
    (0..PLACES).fold(0.0, |largest: f64, place| {
        let argument = function.place((f32::from(place) + 0.5) / f32::from(PLACES));
        let exact = function.exact(argument);
        let error = f64::from(call(function, library, argument)) - exact;
        let unit = if function == Function::Ln { 1.0 } else { exact };
        largest.max((error / unit).abs())
    })
}

/// A fit and the check compute e = exp(-u^2 / 2) at one pixel, its ratio to the next, and the factor by which
/// that ratio falls. `i` counts the three, then places within a pixel, then widths.
fn exponent(i: usize) -> f32 {
    let phase = (i / 3 % PHASES) as f32 / PHASES as f32;
    let width = WIDTHS.get(i / 3 / PHASES % WIDTHS.len()).copied();
    let pitch = 1.0 / width.unwrap_or(1.0);
    let u = phase * pitch;
    match i % 3 {
        0 => -0.5 * u * u,
        1 => -pitch * (u + 0.5 * pitch),
        _ => -pitch * pitch,
    }
}

/// Calls a function. `dual-mac` has only the square root; its other functions are those of `libm`.
#[inline(always)]
pub fn call(function: Function, library: Library, argument: f32) -> f32 {
    match (function, library) {
        (Function::Exp, Library::Micromath) => F32(argument).exp().0,
        (Function::Exp, _) => libm::expf(argument),
        (Function::Ln, Library::Micromath) => F32(argument).ln().0,
        (Function::Ln, _) => libm::logf(argument),
        (Function::SquareRoot, Library::Libm) => libm::sqrtf(argument),
        (Function::SquareRoot, Library::Micromath) => F32(argument).sqrt().0,
        (Function::SquareRoot, Library::DualMac) => dual_mac::square_root(argument),
    }
}
