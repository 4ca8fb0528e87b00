//! The plan of a frame: sensor, spot and fault, from which its rows are made.
//!
//! A fault is drawn once for a frame and stays in all its rows, as dust and reflections do. Only noise
//! differs from row to row, and in some frames the spot moves.

use crate::hard_cases::Truth;
use crate::second_judge::sensor::{Sensor, convert};
use crate::second_judge::spot::Spot;
use crate::second_judge::{ROWS_OF_FRAME, Rng, log_even};
use rand::Rng as _;
use simulator::with;
use slitrange::row::Geometry;

/// When a row is taken, and where its spot is then.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// Number of the row in its frame.
    pub row: usize,
    /// The spot.
    pub spot: Spot,
}

/// A transmission at a place in pixels.
type Glass = Box<dyn Fn(f64) -> f64>;

/// Changes of pixels, in counts.
#[derive(Default)]
pub struct Changes<T>(Vec<Change<T>>);

type Change<T> = Box<dyn Fn(&mut [T], &Moment, &mut Rng)>;

impl<T> Changes<T> {
    /// One change more.
    pub fn add(&mut self, change: impl Fn(&mut [T], &Moment, &mut Rng) + 'static) {
        self.0.push(Box::new(change));
    }

    fn apply(&self, pixels: &mut [T], moment: &Moment, random: &mut Rng) {
        self.0.iter().for_each(|it| it(pixels, moment, random));
    }
}

/// A frame to be.
pub struct Plan {
    /// Number of rows.
    pub rows: usize,
    /// The sensor.
    pub sensor: Sensor,
    /// The spot in the middle of the frame.
    pub spot: Spot,
    /// Pixels that the spot moves from row to row.
    pub speed: f64,
    /// Pixels by which the spot of each row is elsewhere, beside the steady motion. Empty: by none.
    pub shifts: Vec<f64>,
    /// What a perfect reader would say.
    pub truth: Truth,
    /// What lies before the sensor, and dims the spot.
    glass: Vec<Glass>,
    /// Other light, and pixels that see it differently: before the shot noise.
    pub light: Changes<f64>,
    /// Charge in the pixels.
    pub charge: Changes<f64>,
    /// Voltages at the converter, black level included.
    pub volts: Changes<f64>,
    /// Counts of the light pixels.
    pub counts: Changes<u16>,
    /// Words of the read-out.
    pub words: Changes<u16>,
    /// The rows that a calibration saw.
    calibration: Vec<Vec<u16>>,
}

/// The least height of the spot that a calibration sees, in counts: a person takes care that it is bright.
const CALIBRATED_HEIGHT: f64 = 1000.0;

/// A frame, and what a perfect reader would say of it.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The words of its read-outs.
    pub rows: Vec<Vec<u16>>,
    /// What the firmware knows of the sensor.
    pub geometry: Geometry,
    /// Where the spot is, in pixels of the light range.
    pub truth: Truth,
    /// The spot without the fault, in the middle of the frame.
    pub spot: Spot,
    /// The sensor without the fault.
    pub sensor: Sensor,
    /// The words of read-outs of the same spot without a fault, at rest and bright: what a calibration saw.
    pub calibration: Vec<Vec<u16>>,
}

impl Plan {
    /// A clean frame. Width: that of the default optics, 7 to 9 pixels, in two of three frames, else 1.2 to
    /// 16. Height: 60 to 3800 counts. In one of four frames the spot moves, by up to half a pixel in all.
    pub fn draw(rows: usize, random: &mut Rng) -> Self {
        let sensor = Sensor::draw(random);
        let width = if random.random_bool(2.0 / 3.0) {
            random.random_range(7.0..9.0)
        } else {
            log_even(random, 1.2, 16.0)
        };
        let height = log_even(random, 60.0, 3800.0).min(sensor.room());
        // Far enough from the edges for the widest spot.
        let centre = random.random_range(0.35..0.65) * sensor.pixels as f64;
        let speed = if random.random_bool(0.25) {
            random.random_range(-0.5..0.5) / ROWS_OF_FRAME as f64
        } else {
            0.0
        };
        Self {
            rows,
            sensor,
            spot: Spot::draw(random, centre, width, height),
            speed,
            shifts: vec![],
            truth: Truth::Centre(centre),
            glass: vec![],
            light: Changes::default(),
            charge: Changes::default(),
            volts: Changes::default(),
            counts: Changes::default(),
            words: Changes::default(),
            calibration: vec![],
        }
    }

    /// Moves the spot to another place.
    pub fn place(&mut self, centre: f64) {
        self.spot.centre = centre;
        self.truth = Truth::Centre(centre);
    }

    /// Takes the spot away: a perfect reader says that there is none.
    pub fn remove_spot(&mut self) {
        self.spot.height = 0.0;
        self.truth = Truth::None;
    }

    /// Leaves room below full scale for so many counts of other light.
    pub fn leave_room(&mut self, counts: f64) {
        self.spot.height = self.spot.height.min(self.sensor.room() - counts).max(60.0);
    }

    /// Leaves room below full scale for other light on the spot, as a share of the spot's height.
    pub fn leave_share(&mut self, share: f64) {
        self.spot.height = self.spot.height.min(self.sensor.room() / (1.0 + share));
    }

    /// Puts a glass with a transmission at each place before the sensor.
    pub fn glass(&mut self, transmission: impl Fn(f64) -> f64 + 'static) {
        self.glass.push(Box::new(transmission));
    }

    /// Adds to the light of each pixel, before its shot noise, what a function gives for the pixel's number.
    pub fn add_light(&mut self, added: impl Fn(f64) -> f64 + 'static) {
        self.light.add(move |pixels, _, _| add(pixels, &added));
    }

    /// Adds to the voltage of each pixel what a function gives for the pixel's number.
    pub fn add_volts(&mut self, added: impl Fn(f64) -> f64 + 'static) {
        self.volts.add(move |pixels, _, _| add(pixels, &added));
    }

    /// Takes the frame's rows.
    pub fn frame(self, random: &mut Rng) -> Frame {
        let middle = 0.5 * (self.rows as f64 - 1.0);
        let mut seen: Option<Vec<f64>> = None;
        let rows = (0..self.rows)
            .map(|row| {
                let shift = self.shifts.get(row).copied().unwrap_or_default();
                let spot = Spot {
                    centre: self.spot.centre + self.speed * (row as f64 - middle) + shift,
                    ..self.spot
                };
                // A spot at rest has the same light in every row.
                let light = match &seen {
                    Some(light) if self.speed == 0.0 && self.shifts.is_empty() => light.clone(),
                    _ => {
                        let mut light = vec![0.0; self.sensor.pixels];
                        spot.add_to(&mut light, |place| {
                            self.glass.iter().map(|glass| glass(place)).product()
                        });
                        seen.insert(light).clone()
                    }
                };
                self.row(light, &Moment { row, spot }, random)
            })
            .collect();
        Frame {
            rows,
            geometry: self.sensor.geometry(),
            truth: self.truth,
            spot: self.spot,
            sensor: self.sensor,
            calibration: self.calibration,
        }
    }

    /// Takes the rows that a calibration sees. A fault that changes the sensor, or the shape or the width of
    /// the spot without the fault, calls this again before it adds its changes.
    pub fn calibrate(&mut self, random: &mut Rng) {
        let spot = with(self.spot, |it| {
            it.height = self.spot.height.max(CALIBRATED_HEIGHT)
        });
        self.calibration = (0..ROWS_OF_FRAME)
            .map(|row| {
                let mut light = vec![0.0; self.sensor.pixels];
                spot.add_to(&mut light, |_| 1.0);
                self.row(light, &Moment { row, spot }, random)
            })
            .collect();
    }

    fn row(&self, mut pixels: Vec<f64>, moment: &Moment, random: &mut Rng) -> Vec<u16> {
        self.light.apply(&mut pixels, moment, random);
        self.sensor.expose(&mut pixels, random);
        self.charge.apply(&mut pixels, moment, random);
        self.sensor.amplify(&mut pixels, random);
        self.volts.apply(&mut pixels, moment, random);
        let mut counts: Vec<u16> = pixels.into_iter().map(convert).collect();
        self.counts.apply(&mut counts, moment, random);
        let mut words = self.sensor.words(&counts, random);
        self.words.apply(&mut words, moment, random);
        words
    }
}

/// Adds what a function gives for a pixel's number.
pub fn add(pixels: &mut [f64], added: impl Fn(f64) -> f64) {
    for (i, pixel) in pixels.iter_mut().enumerate() {
        *pixel += added(i as f64);
    }
}
