//! Made-up measurements for tests of the report and of the figures.

use cost_on_chip::methods::Method;
use judges::accuracy::Outcome;

use crate::prelude::*;
use crate::programs::cost::accuracy::{
    Accuracy, Bias, InSituation, MethodOnCell, NOISES, SITUATIONS, WIDTHS,
};
use crate::programs::cost::chip::steps::Steps;
use crate::programs::cost::chip::whole_rows::{
    FIRST, FOLLOWING, LAST, READING, SLOWEST, WholeRows,
};
use crate::programs::cost::chip::{Chip, MethodOnChip};
use crate::programs::cost::reading_time::{self, Light, Point};
use crate::programs::cost::report::Measured;

const CHIP_WIDTHS: [f64; 5] = [1.5, 4.5, 10.5, 11.3, 25.0];

pub fn measured() -> Measured {
    let mut accuracy = Accuracy {
        rows: 100,
        cells: vec![],
        situations: vec![],
        biases: vec![],
    };
    let mut chip = Chip {
        whole_rows: whole_rows(),
        core_files: BTreeSet::new(),
        ..Chip::default()
    };
    for (number, method) in (1..).zip(Method::ALL) {
        let outcome = Outcome {
            rmse: 0.02 + 0.002 * number as f64,
            bound: 0.02,
            pull: 1.0,
            faults: 0,
            gross: 0,
        };
        for width in WIDTHS {
            accuracy.cells.extend(NOISES.map(|noise| MethodOnCell {
                method,
                width,
                noise,
                outcome,
            }));
            accuracy.biases.push(Bias {
                method,
                width,
                pixels: Some(0.001 * number as f64),
            });
        }
        let situations = (0..SITUATIONS.len()).map(|situation| InSituation {
            situation,
            method,
            outcome,
        });
        accuracy.situations.extend(situations);
        chip.methods.extend(CHIP_WIDTHS.map(|width| MethodOnChip {
            name: method.name().into(),
            width,
            instructions: 500 * number,
            ..MethodOnChip::default()
        }));
    }
    Measured {
        methods: Method::ALL.to_vec(),
        accuracy,
        chip,
        distances: String::new(),
        floats: String::new(),
        without_fpu: String::new(),
        host_ns: Method::ALL.map(|_| Some(70.0)).into(),
        readings: readings(),
        peers: vec![],
    }
}

fn whole_rows() -> WholeRows {
    let mut rows = WholeRows::default();
    for (number, name) in (1..).zip(Estimator::ALL.map(Estimator::name)) {
        let row = |parts: u64| Steps([3000, 4000 * parts, 500 * number, 5000 * parts, 460, 0, 0]);
        for width in CHIP_WIDTHS.map(Some) {
            rows.add(FOLLOWING, name, width, row(1));
            rows.add(FIRST, name, width, row(4));
        }
        rows.add(LAST, name, Some(10.5), row(2));
        rows.add(READING, name, Some(10.5), Steps([0, 0, 0, 0, 0, 600, 0]));
        rows.add(SLOWEST, name, None, row(25));
    }
    rows
}

fn readings() -> Vec<Point> {
    let cases = Light::ALL.into_iter().flat_map(|light| {
        let of_light = Estimator::ALL
            .map(|estimator| (light, estimator))
            .into_iter();
        of_light.flat_map(|of| reading_time::ROWS.map(|rows| (of, rows)))
    });
    cases
        .map(|((light, estimator), rows)| {
            let (n, micrometres) = (rows as f64, 100.0 / (rows as f64).sqrt());
            Point {
                light,
                estimator,
                rows,
                computing_milliseconds: n * 0.1 + 0.3,
                milliseconds: n / reading_time::ROWS_PER_SECOND * 1e3,
                micrometres,
                bound_micrometres: 0.9 * micrometres,
                u_micrometres: micrometres,
                r_micrometres: micrometres,
            }
        })
        .collect()
}
