//! A stage that moves the target to the position in a file, or covers the sensor.

use std::path::PathBuf;

use crate::light::Target;

/// The stage and its position.
#[derive(Debug)]
pub struct Stage {
    file: PathBuf,
    target: Target,
    /// The position to which the target was last moved, in millimetres.
    position: Option<f64>,
}

impl Stage {
    /// A stage that has not read its file yet.
    pub fn new(file: impl Into<PathBuf>, target: Target) -> Self {
        Self {
            file: file.into(),
            target,
            position: None,
        }
    }

    /// Reads the file and moves the target to its position. The word `covered` in its place covers the sensor
    /// until a position follows. If there is no file, or neither in it, all stays as it is: the program that
    /// writes the file may not have finished.
    pub fn look(&mut self) {
        let text = std::fs::read_to_string(&self.file).unwrap_or_default();
        self.follow(&text);
    }

    fn follow(&mut self, text: &str) {
        let position = millimetres(text);
        if text.trim() == "covered" {
            self.target.cover(true);
            self.position = None;
        } else if let Some(millimetres) = position
            && position != self.position
        {
            self.target.cover(false);
            self.target.move_to(1e-3 * millimetres);
            self.position = position;
        }
    }
}

fn millimetres(text: &str) -> Option<f64> {
    let number: f64 = text.trim().parse().ok()?;
    (number > 0.0 && number.is_finite()).then_some(number)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::{LIGHT, of_scene};
    use crate::sensor_head::Exposure;
    use simulator::scene::Scene;

    #[test]
    fn a_distance_is_a_positive_number() {
        assert_eq!(millimetres("812.5\n"), Some(812.5));
        assert_eq!(millimetres(" 600"), Some(600.0));
        for text in ["", "\n", "-600", "0", "nan", "inf", "600 mm", "6e999"] {
            assert_eq!(millimetres(text), None, "{text:?}");
        }
    }

    /// A cover leaves the black level of 300 counts. Without it come the 2000 counts of `even-light`, less
    /// the part of its 5.7 ms that a row of 5 ms misses.
    #[test]
    fn the_word_covered_covers_the_sensor_until_a_distance_follows() {
        let target = Target::at(0.8);
        let mut light = of_scene(Scene::load("even-light").expect("a scene"), target.clone());
        let mut stage = Stage::new("", target);
        let (start, end, laser) = (0, 5_000_000, 0);
        for (text, counts) in [("", 2055.0), ("covered\n", 300.0), ("800", 2055.0)] {
            stage.follow(text);
            let row = light(&Exposure { start, end, laser });
            let mean = statistics::mean(row[LIGHT].iter().map(|&it| f64::from(it)));
            println!("{text:?}: {mean:.1} counts");
            // Pixels differ by 2 % and 5 counts: their mean by 0.7 counts.
            assert!((mean - counts).abs() < 3.0);
        }
    }
}
