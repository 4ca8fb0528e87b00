//! How near each method comes to the Cramér-Rao bound, over widths, heights and kinds of noise.

use cost_on_chip::methods::{self, Method};
use indicatif::ProgressBar;
use judges::accuracy::{Cell, Outcome, Rows, largest_bias};

/// Widths (sigma) of the grid in pixels.
pub const WIDTHS: [f64; 12] = [
    0.8, 1.2, 1.6, 2.0, 3.0, 4.6, 6.7, 8.0, 10.5, 13.4, 18.0, 30.0,
];

/// The widths in pixels that the estimators are made for, over which their worst figures are taken. A
/// narrower spot is hardly wider than a pixel, and a wider one is beyond the optics.
pub const MEANT_FOR: std::ops::RangeInclusive<f64> = 1.2..=18.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// The spot's height in counts.
    pub amplitude: f64,
    /// That of the light's quanta. `None`: the noise is white.
    pub electrons_per_count: Option<f64>,
    /// Standard deviation of the white noise in counts.
    pub read_noise: f64,
}

/// White noise with this ratio of the spot's height to its standard deviation. The height leaves room for the
/// noise's peaks at any ratio.
pub const fn white(snr: f64) -> Noise {
    Noise {
        amplitude: 2400.0,
        electrons_per_count: None,
        read_noise: 2400.0 / snr,
    }
}

pub const fn shot(amplitude: f64, electrons_per_count: f64, read_noise: f64) -> Noise {
    Noise {
        amplitude,
        electrons_per_count: Some(electrons_per_count),
        read_noise,
    }
}

pub const NOISES: [Noise; 10] = [
    white(25.0),
    white(100.0),
    white(500.0),
    white(1800.0),
    shot(100.0, 5.0, 4.0),
    shot(1000.0, 5.0, 2.0),
    shot(1000.0, 2.0, 8.0),
    shot(3800.0, 10.0, 1.0),
    shot(3800.0, 10.0, 8.0),
    shot(3800.0, 2.0, 2.0),
];

impl Noise {
    fn cell(self, width: f64, rows: u64) -> Cell {
        Cell {
            width,
            amplitude: self.amplitude,
            read_noise: self.read_noise,
            electrons_per_count: self.electrons_per_count,
            rows,
            seed: 3,
        }
    }

    pub const fn is_white(self) -> bool {
        self.electrons_per_count.is_none()
    }
}

#[derive(Clone, Copy, Debug)]
pub struct MethodOnCell {
    pub method: Method,
    /// Sigma in pixels.
    pub width: f64,
    pub noise: Noise,
    pub outcome: Outcome,
}

#[derive(Clone, Copy, Debug)]
pub struct Bias {
    pub method: Method,
    /// Sigma in pixels.
    pub width: f64,
    /// In pixels; `None` where the method finds no centre in a noiseless row.
    pub pixels: Option<f64>,
}

/// A spot as one meets it, to show accuracy against time on.
pub struct Situation {
    pub name: &'static str,
    /// The width at which the chip's time was measured.
    pub chip_width: f64,
    noise: Noise,
    hot_pixel: Option<f64>,
}

pub const SITUATIONS: [Situation; 4] = [
    Situation {
        name: "White noise, SNR 100, σ 10.5 px",
        chip_width: 10.5,
        noise: white(100.0),
        hot_pixel: None,
    },
    Situation {
        name: "Shot noise, 2000 counts, σ 10.5 px",
        chip_width: 10.5,
        noise: shot(2000.0, 5.0, 2.0),
        hot_pixel: None,
    },
    Situation {
        name: "Shot noise, 2000 counts, a narrow spot: σ 1.5 px",
        chip_width: 1.5,
        noise: shot(2000.0, 5.0, 2.0),
        hot_pixel: None,
    },
    Situation {
        name: "Shot noise, 2000 counts, σ 10.5 px, and a hot pixel of 1000 counts",
        chip_width: 10.5,
        noise: shot(2000.0, 5.0, 2.0),
        hot_pixel: Some(1000.0),
    },
];

/// Where more of the rows than this have no centre, the error of the others is not the method's: those are
/// the easy ones.
pub const MOST_FAULTS: f64 = 0.1;

#[derive(Clone, Copy, Debug)]
pub struct InSituation {
    /// Index into [`SITUATIONS`].
    pub situation: usize,
    pub method: Method,
    pub outcome: Outcome,
}

pub struct Accuracy {
    pub rows: u64,
    pub cells: Vec<MethodOnCell>,
    pub situations: Vec<InSituation>,
    pub biases: Vec<Bias>,
}

/// Runs the methods over the grid, `rows` rows a cell.
pub fn measure(methods: &[Method], rows: u64) -> Accuracy {
    let bar = ProgressBar::new((WIDTHS.len() * (NOISES.len() + 1) + SITUATIONS.len()) as u64);
    bar.set_message("accuracy");
    let mut accuracy = Accuracy {
        rows,
        cells: vec![],
        situations: vec![],
        biases: vec![],
    };
    for width in WIDTHS {
        for noise in NOISES {
            let outcomes = Rows::of(noise.cell(width, rows)).run_by(methods, methods::centre);
            let of_method = |(&method, outcome)| MethodOnCell {
                method,
                width,
                noise,
                outcome,
            };
            let outcomes = methods.iter().zip(outcomes);
            accuracy.cells.extend(outcomes.map(of_method));
            bar.inc(1);
        }
        accuracy.biases.extend(methods.iter().map(|&method| Bias {
            method,
            width,
            pixels: largest_bias(method, methods::centre, width),
        }));
        bar.inc(1);
    }
    for (i, situation) in SITUATIONS.iter().enumerate() {
        let rows = Rows {
            hot_pixel: situation.hot_pixel,
            ..Rows::of(situation.noise.cell(situation.chip_width, rows))
        };
        let outcomes = rows.run_by(methods, methods::centre);
        let of_method = |(&method, outcome)| InSituation {
            situation: i,
            method,
            outcome,
        };
        let outcomes = methods.iter().zip(outcomes);
        accuracy.situations.extend(outcomes.map(of_method));
        bar.inc(1);
    }
    bar.finish_and_clear();
    accuracy
}

/// The worst of a method's figures over the widths it is meant for.
#[derive(Clone, Copy, Debug)]
pub struct Worst {
    /// RMSE over the bound in white noise.
    pub white: f64,
    /// RMSE over the bound in shot and read noise.
    pub shot: f64,
    /// Bias in pixels.
    pub bias: Option<f64>,
    /// Smallest and largest standard deviation of error over claim.
    pub pull: (f64, f64),
    /// Largest part of a cell's rows without a centre.
    pub faults: f64,
    /// Largest part of a cell's rows whose centre is grossly wrong.
    pub gross: f64,
}

impl Accuracy {
    pub fn faults(&self, outcome: &Outcome) -> f64 {
        outcome.faults as f64 / self.rows as f64
    }

    pub fn worst(&self, method: Method) -> Worst {
        let is_meant = |of: Method, width: f64| of == method && MEANT_FOR.contains(&width);
        let cells = || (self.cells.iter()).filter(|it| is_meant(it.method, it.width));
        let mut biases = (self.biases.iter()).filter(|it| is_meant(it.method, it.width));
        let ratio = |white| {
            let cells = cells().filter(|cell| cell.noise.is_white() == white);
            cells.map(|it| it.outcome.ratio()).fold(f64::NAN, f64::max)
        };
        let part = |rows: fn(&Outcome) -> u64| {
            cells().map(|cell| rows(&cell.outcome)).max().unwrap_or(0) as f64 / self.rows as f64
        };
        let pulls = || cells().map(|cell| cell.outcome.pull);
        Worst {
            white: ratio(true),
            shot: ratio(false),
            bias: biases.try_fold(0.0f64, |worst, bias| Some(worst.max(bias.pixels?))),
            pull: (
                pulls().fold(f64::NAN, f64::min),
                pulls().fold(f64::NAN, f64::max),
            ),
            faults: part(|outcome| outcome.faults),
            gross: part(|outcome| outcome.gross),
        }
    }
}
