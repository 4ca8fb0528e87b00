//! The answer to `help estimator`: what each rung costs and gives, so that it can be chosen before it is tried.

use core::fmt;

use crate::estimator::Estimator;
use crate::estimator::figures::{FIGURES, Figures};

/// The answer to `help estimator`: a line that names the columns and a line a rung, parted by CR LF. A rung's line begins
/// as the line of a reading ends, and so cannot be taken for a fault as `f fraunhofer` could.
#[derive(Clone, Copy, Debug)]
pub struct Ladder;

impl fmt::Display for Ladder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(
            "    name          instr.     us  white   shot  (a row; RMSE / bound at worst)",
        )?;
        for figures in FIGURES {
            let Figures {
                estimator,
                instructions,
                microseconds_tenths,
                white_percent,
                shot_percent,
            } = figures;
            write!(
                f,
                "\r\ne {} {:13} {instructions:6} {:4}.{} {:3}.{:02} {:3}.{:02}  {}",
                estimator.letter(),
                estimator.name(),
                microseconds_tenths / 10,
                microseconds_tenths % 10,
                white_percent / 100,
                white_percent % 100,
                shot_percent / 100,
                shot_percent % 100,
                purpose(estimator)
            )?;
        }
        Ok(())
    }
}

/// What a rung is for.
const fn purpose(estimator: Estimator) -> &'static str {
    match estimator {
        Estimator::Centroid => "what most firmware does",
        Estimator::Parabola => "three pixels, narrow spots",
        Estimator::LogParabola => "the same, without its bias",
        Estimator::ZeroCrossing => "cheap, for wide spots",
        Estimator::Blocks => "sums of pixels",
        Estimator::PhaseTable => "the default",
        Estimator::Adaptive => "the most accurate tables",
        Estimator::Robust => "hot pixels, second spots",
        Estimator::GaussNewton => "spots cut off",
        Estimator::Fraunhofer => "laser spots below 1 mm",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::MAX_ANSWER;

    #[test]
    fn every_rung_has_a_line_with_its_figures() {
        let text = Ladder.to_string();
        println!("{text}");
        let (_, rungs) = text.split_once("\r\n").expect("a line for the columns");
        let rungs: Vec<&str> = rungs.split("\r\n").collect();
        assert_eq!(rungs.len(), Estimator::ALL.len());
        for ((line, figures), estimator) in rungs.iter().zip(FIGURES).zip(Estimator::ALL) {
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            let ["e", letter, name, instructions, time, white, shot, ..] = words[..] else {
                panic!("{line}");
            };
            assert_eq!(letter, estimator.letter().to_string());
            assert_eq!(name, estimator.name());
            assert_eq!(instructions.parse(), Ok(figures.instructions));
            let scaled = |word: &str, scale: f64| {
                (word.parse::<f64>().expect("a number") * scale).round() as u32
            };
            assert_eq!(scaled(time, 10.0), figures.microseconds_tenths, "{line}");
            assert_eq!(
                scaled(white, 100.0),
                u32::from(figures.white_percent),
                "{line}"
            );
            assert_eq!(
                scaled(shot, 100.0),
                u32::from(figures.shot_percent),
                "{line}"
            );
            assert!(words.len() > 7, "{line}: what is it for?");
        }
    }

    #[test]
    fn it_fits_the_screen_and_the_answer_buffer() {
        let text = Ladder.to_string();
        assert!(text.split("\r\n").all(|line| line.len() <= 80), "{text}");
        assert!(text.len() + 2 <= MAX_ANSWER, "{}", text.len());
    }
}
