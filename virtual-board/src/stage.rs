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
        let position = millimetres(&text);
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

    #[test]
    fn a_distance_is_a_positive_number() {
        assert_eq!(millimetres("812.5\n"), Some(812.5));
        assert_eq!(millimetres(" 600"), Some(600.0));
        for text in ["", "\n", "-600", "0", "nan", "inf", "600 mm", "6e999"] {
            assert_eq!(millimetres(text), None, "{text:?}");
        }
    }
}
