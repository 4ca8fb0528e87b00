//! Table 1 as the paper has it: the figures to which the simulation's are compared.

/// MAX and MAE in micrometres, in the order of [`MATERIALS`](crate::paper::materials::MATERIALS). Of each
/// material those of the paper's methods, which are the first of
/// [`Method::ALL`](crate::paper::methods::Method::ALL).
pub const TABLE_1: [[[f64; 2]; 3]; 6] = [
    [[851.0, 182.0], [520.0, 115.0], [527.0, 155.0]],
    [[860.0, 164.0], [640.0, 158.0], [638.0, 158.0]],
    [[651.0, 151.0], [429.0, 72.0], [476.0, 81.0]],
    [[812.0, 144.0], [468.0, 81.0], [437.0, 72.0]],
    [[1098.0, 280.0], [735.0, 134.0], [743.0, 134.0]],
    [[677.0, 154.0], [602.0, 118.0], [600.0, 119.0]],
];
