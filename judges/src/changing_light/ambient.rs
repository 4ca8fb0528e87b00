//! White paper in ambient light: the errors with and without `ambient subtract`, beside those in a dark room.

use super::range::Frames;
use super::{BRIGHTEST, ROW_PERIOD, Sensor, scene};
use simulator::bound::Spot;
use simulator::scene::{Ambient, FixedPattern, Lag, MainsLight, Scene};
use slitrange::base::exposure::{Exposure, ExposureMode};
use slitrange::light::ambient::{AmbientMode, LONGEST_LOG2};
use slitrange::measurement::Options;

/// Rows with the laser on before frames count, so that the mean of the ambient light is at its longest.
const ROWS_TO_SETTLE: usize = 600;
/// White paper's spot (`scenes/quiet-paper.toml`) over the one of a reflectivity of 1.
pub const WHITE_PAPER: f64 = 350e3 / BRIGHTEST;
/// The laser is on for 5 ms, as in `scenes/sunlit.toml`: 1750 counts.
const EXPOSURE_US: u16 = 5000;

/// Ambient light to measure in.
#[derive(Clone, Copy)]
pub struct Light {
    /// Its name, as in a table.
    pub name: &'static str,
    ambient: Option<Ambient>,
    lamps: Option<MainsLight>,
    pattern: Option<FixedPattern>,
    lag: Option<Lag>,
    lamp: fn(&mut [f32]),
}

/// No light but the laser's.
pub const DARK_ROOM: Light = Light {
    name: "dark room",
    ambient: None,
    lamps: None,
    pattern: None,
    lag: None,
    lamp: |_| (),
};

/// A dark room, and a sensor in whose pixels charge stays for the next row: at most 100 counts, which are
/// 1000 electrons, and all of faint light (M. C. Nelson, TCD1304-Sensor-Device, GitHub, 2026; see [`Lag`]).
pub const CHARGE_STAYS: Light = Light {
    name: "dark room, charge stays",
    lag: Some(Lag {
        counts: 100.0,
        share: 1.0,
    }),
    ..DARK_ROOM
};

/// The window of `scenes/sunlit.toml`, so many times as bright.
const fn window(name: &'static str, times: f64) -> Light {
    Light {
        name,
        ambient: Some(Ambient {
            counts_per_second: 100e3 * times,
            slope: 11.0 * times,
        }),
        ..DARK_ROOM
    }
}

/// Lamps as bright as the window and from the same side. Their light goes down to zero in each period.
const fn lamps(name: &'static str, frequency: f64) -> Light {
    Light {
        name,
        lamps: Some(MainsLight {
            counts_per_second: 100e3,
            slope: 11.0,
            modulation: 1.0,
            frequency,
            phase: None,
        }),
        ..DARK_ROOM
    }
}

/// All lights.
pub const LIGHTS: [Light; 7] = [
    DARK_ROOM,
    window("beside a window", 1.0),
    window("beside a window, three times as bright", 3.0),
    lamps("lamps at 100 Hz", 100.0),
    lamps("lamps at 120 Hz", 120.0),
    Light {
        name: "the image of a lamp, 40 pixels from the spot",
        lamp: image_beside_the_spot,
        ..DARK_ROOM
    },
    Light {
        name: "pixels that differ in the dark",
        pattern: Some(FixedPattern { counts: 6.0 }),
        ..DARK_ROOM
    },
];

/// The sharp image of a small lamp: 400 counts high, with a sigma of 6 pixels.
fn image_beside_the_spot(light: &mut [f32]) {
    let centre = scene().optics.centre(scene().distance) as f32 + 40.0;
    for (light, pixel) in light.iter_mut().zip(0u16..) {
        let u = (f32::from(pixel) - centre) / 6.0;
        *light += 400.0 * (-0.5 * u * u).exp();
    }
}

impl Light {
    fn scene(&self) -> Scene {
        Scene {
            ambient: self.ambient,
            mains_light: self.lamps,
            fixed_pattern: self.pattern,
            lag: self.lag,
            ..scene()
        }
    }

    /// A sensor in this light.
    pub fn sensor(&self, options: Options) -> Sensor {
        Sensor::new(self.scene(), options).with_lamp(self.lamp)
    }

    /// A sensor with the fixed exposure, whose mean of the ambient light is at its longest.
    pub fn settled(&self, ambient: AmbientMode, rows: u16) -> Sensor {
        let exposure = Exposure::from_us(EXPOSURE_US).expect("an exposure");
        let options = Options {
            ambient,
            rows,
            exposure: ExposureMode::Fixed(exposure),
            ..Options::default()
        };
        let mut sensor = self.sensor(options);
        for _ in 0..ROWS_TO_SETTLE {
            sensor.row(WHITE_PAPER);
        }
        sensor.start_frame();
        sensor
    }

    /// Measures so many frames of so many rows with the laser on.
    pub fn measure(&self, ambient: AmbientMode, rows: u16, frames: usize) -> Frames {
        Frames::measure(&mut self.settled(ambient, rows), WHITE_PAPER, frames)
    }

    /// By how much the Cramér-Rao bound of a frame's centre is larger in this light than in a dark room, by
    /// the light's shot noise and the noise of the mean.
    pub fn computed_price(&self, ambient: AmbientMode, rows: u16) -> f64 {
        let scene = self.scene();
        let read = scene.read_noise.map_or(0.0, |it| it.counts);
        let electrons = scene.shot_noise.map(|it| it.electrons_per_count);
        let at_the_spot = scene.optics.centre(scene.distance) - 1823.5;
        let brightness = |counts: f64, slope: f64| counts + slope * at_the_spot;
        let window = (self.ambient).map_or(0.0, |it| brightness(it.counts_per_second, it.slope));
        let lamps = (self.lamps).map_or(0.0, |it| brightness(it.counts_per_second, it.slope));
        let counts = ROW_PERIOD * (window + lamps);
        // The pixels' differences are noise too, unless subtracted: the same in all rows of a frame.
        let pattern = match (self.pattern, ambient) {
            (Some(pattern), AmbientMode::Off) => pattern.counts.powi(2) * f64::from(rows),
            _ => 0.0,
        };
        let of_row =
            read * read + electrons.map_or(0.0, |electrons| counts / electrons) + 1.0 / 12.0;
        let of_mean = match ambient {
            AmbientMode::Off => 0.0,
            // Subtracting rounds once more.
            AmbientMode::Subtract => of_row * noise_of_mean(rows) + 1.0 / 12.0,
        };
        let bound = |variance: f64| {
            let spot = Spot {
                width: 8.6,
                amplitude: 350e3 * f64::from(EXPOSURE_US) * 1e-6,
                // The bound adds the variance of rounding.
                noise: (variance - 1.0 / 12.0).sqrt(),
                electrons_per_count: electrons,
            };
            spot.bound()
        };
        bound(of_row + of_mean + pattern) / bound(read * read + 1.0 / 12.0)
    }
}

/// The variance of the mean ambient light that a frame of so many rows has subtracted, over the variance of
/// the mean of the frame's rows themselves.
///
/// The mean after row j is the sum of a (1 - a)^k over the rows with the laser off, k rows before. A frame
/// subtracts the mean of n such means.
pub fn noise_of_mean(rows: u16) -> f64 {
    let part = 1.0 / f64::from(1u32 << LONGEST_LOG2);
    let rows = i32::from(rows);
    // The weight of each row with the laser off, the last of the frame first.
    let weight = |before: i32| {
        let means = (0..rows).map(|j| before - j).filter(|&age| age >= 0);
        means.map(|age| part * (1.0 - part).powi(age)).sum::<f64>() / f64::from(rows)
    };
    let variance: f64 = (0..10_000).map(|before| weight(before).powi(2)).sum();
    variance * f64::from(rows)
}
