//! Table 1 as the paper has it: the figures to which the simulation's are compared.

/// The errors of a method on a material, in micrometres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    pub max: f64,
    pub mae: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Published {
    pub lens: Errors,
    pub gaussian: Errors,
    pub fraunhofer: Errors,
}

/// MAX and MAE of lens, gaussian and Fraunhofer.
const fn row([a, b, c, d, e, f]: [f64; 6]) -> Published {
    Published {
        lens: Errors { max: a, mae: b },
        gaussian: Errors { max: c, mae: d },
        fraunhofer: Errors { max: e, mae: f },
    }
}

/// In the order of [`MATERIALS`](crate::paper::materials::MATERIALS).
pub const TABLE_1: [Published; 6] = [
    row([851.0, 182.0, 520.0, 115.0, 527.0, 155.0]),
    row([860.0, 164.0, 640.0, 158.0, 638.0, 158.0]),
    row([651.0, 151.0, 429.0, 72.0, 476.0, 81.0]),
    row([812.0, 144.0, 468.0, 81.0, 437.0, 72.0]),
    row([1098.0, 280.0, 735.0, 134.0, 743.0, 134.0]),
    row([677.0, 154.0, 602.0, 118.0, 600.0, 119.0]),
];
