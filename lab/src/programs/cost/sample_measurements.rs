//! Made-up measurements, for tests of the report and for a look at the figures.

use cost_on_chip::methods::Method;
use judges::accuracy::Outcome;
use slitrange::centre::Estimator;

use crate::programs::cost::accuracy::{
    Accuracy, Bias, InSituation, MethodOnCell, NOISES, Noise, SITUATIONS, WIDTHS,
};
use crate::programs::cost::chip::steps::Steps;
use crate::programs::cost::chip::whole_rows::{AtWidth, OnceAFrame, Slowest, WholeRows};
use crate::programs::cost::chip::{Chip, MethodOnChip};
use crate::programs::cost::reading_time::{self, Light, Point};
use crate::programs::cost::report::Measured;

/// Name, RMSE over the bound in white and shot noise, bias at a width of a pixel, instructions, code and
/// tables in bytes.
const METHODS: [(f64, f64, f64, u64, u64, u64); 6] = [
    (1.9, 1.3, 0.02, 520, 420, 0),
    (1.06, 1.09, 0.0003, 354, 1100, 9400),
    (1.01, 1.02, 0.0001, 653, 2300, 18_800),
    (1.0, 1.0, 0.00002, 37_600, 4100, 0),
    (1.08, 1.12, 0.004, 354, 1100, 9400),
    (1.03, 1.04, 0.0002, 1420, 3400, 28_200),
];

pub fn measured() -> Measured {
    let methods = || Method::ALL.into_iter().zip(METHODS);
    let outcome = |ratio: f64| Outcome {
        rmse: 0.02 * ratio,
        bound: 0.02,
        pull: 1.0,
        faults: 0,
        gross: 0,
    };
    let mut accuracy = Accuracy {
        rows: 100,
        cells: vec![],
        situations: vec![],
        biases: vec![],
    };
    for (method, (white, shot, bias, ..)) in methods() {
        for width in WIDTHS {
            for noise in NOISES {
                let ratio = if noise.is_white() { white } else { shot };
                let ripple = 0.3 * (ratio - 1.0) * (width * 1.3).sin();
                let snr = match noise {
                    Noise::White { snr } => snr,
                    Noise::Shot { amplitude, .. } => amplitude,
                };
                accuracy.cells.push(MethodOnCell {
                    method,
                    width,
                    noise,
                    outcome: outcome(ratio + ripple + 1e-6 * snr),
                });
            }
            accuracy.biases.push(Bias {
                method,
                width,
                pixels: Some(bias * width.powf(-0.5)),
            });
        }
        for (situation, hot) in SITUATIONS.iter().enumerate().map(|(i, _)| (i, i == 3)) {
            let spared = matches!(
                method,
                Method::Repair | Method::Estimator(Estimator::GaussNewton)
            );
            let ratio = if situation == 0 { white } else { shot };
            accuracy.situations.push(InSituation {
                situation,
                method,
                outcome: outcome(if hot && !spared { ratio * 9.0 } else { ratio }),
            });
        }
    }
    Measured {
        methods: Method::ALL.to_vec(),
        accuracy,
        chip: chip(),
        distances: String::new(),
        floats: String::new(),
        host_ns: METHODS.iter().map(|it| Some(it.3 as f64 / 5.0)).collect(),
        readings: readings(),
        peers: vec![],
    }
}

fn chip() -> Chip {
    let mut methods = vec![];
    for (method, (.., instructions, code_bytes, table_bytes)) in
        Method::ALL.into_iter().zip(METHODS)
    {
        for (width, part) in [(1.5, 4), (4.5, 6), (10.5, 10), (11.3, 10), (25.0, 7)] {
            let instructions = instructions * part / 10;
            methods.push(MethodOnChip {
                name: method.name().into(),
                width,
                instructions,
                code_bytes,
                table_bytes,
                stack_bytes: 200,
                fault: None,
            });
        }
    }
    Chip {
        methods,
        whole_rows: whole_rows(),
        ..Chip::default()
    }
}

fn whole_rows() -> WholeRows {
    let mut rows = WholeRows::default();
    for (estimator, (.., estimate, _, _)) in Estimator::ALL.into_iter().zip(METHODS) {
        let row = |parts: u64| Steps([3000, 4000 * parts, estimate, 5000 * parts, 460, 0, 0]);
        for width in [1.5, 4.5, 10.5, 11.3, 25.0] {
            let parts = if width < 6.0 { 3 } else { 1 };
            rows.at_widths.push(AtWidth {
                estimator,
                width,
                first: row(4),
                following: row(parts),
            });
        }
        let mut last = row(1);
        last.0[4] += 30_000;
        rows.once_a_frame.push(OnceAFrame {
            estimator,
            last,
            distance: Steps([0, 0, 0, 0, 0, 600, 0]),
        });
        rows.slowest.push(Slowest {
            estimator,
            name: "a made-up row".into(),
            row: row(25),
        });
    }
    rows
}

fn readings() -> Vec<Point> {
    let mut points = vec![];
    let cases = Light::ALL
        .into_iter()
        .flat_map(|light| Estimator::ALL.map(|estimator| (light, estimator)));
    for (light, estimator) in cases {
        for rows in reading_time::ROWS {
            let n = rows as f64;
            let micrometres = match light {
                Light::NoiseAlone if estimator == Estimator::Centroid => 9.5 / n.sqrt(),
                Light::NoiseAlone => 6.5 / n.sqrt(),
                Light::SpeckleAtRest => 590.0,
                Light::SpeckleBehindComb => 110.0,
                Light::SpeckleReceding => 580.0 / (1.0 + 0.005 * n),
                Light::SpeckleSliding => 580.0 / (1.0 + 0.2 * n).sqrt(),
            };
            points.push(Point {
                light,
                estimator,
                rows,
                computing_milliseconds: n * 0.1 + 0.3,
                milliseconds: n / reading_time::ROWS_PER_SECOND * 1e3,
                micrometres,
                bound_micrometres: 6.0 / n.sqrt(),
                u_micrometres: micrometres,
                r_micrometres: micrometres,
                faults: 0,
            });
        }
    }
    points
}
