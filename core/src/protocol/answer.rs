//! Answers have the form of the command that they answer: what `rows` answers can be typed to set it again.

use core::fmt;

use super::command::Command;
use crate::black_level::BlackLevel;

/// The answer to `help`: a line a command.
pub const HELP: &str = "\
help [estimator]                       this list, or what each estimator costs and gives\r
info                                   what this sensor is, its calibration and its range\r
status                                 how it fares: rows, readings, faults and errors since the start\r
distance                               the next frame's reading, or its fault and what to do about it\r
centre                                 the next frame's centre, calibrated or not, or its fault\r
stream [on|off]                        a line for every frame\r
rows [1..64]                           rows in a frame\r
mean [plain|weighted]                  how their centres become one\r
black [shielded|frame|fixed 0..4095]   how the black level is found\r
estimator [NAME]                       how the centre of a row is found\r
calibration [on|off]                   what centres mean; distances, or centres only\r
calibration begin BYTES                start to send another calibration's record, for now only in RAM\r
calibration data OFFSET [HEX CRC16]    a piece of the record in use, or of the one that is sent\r
calibration commit|abort               use what was sent, or drop it\r
save                                   keep settings and calibration over a power cycle; pauses the stream\r
defaults                               settings and calibration as they left the factory, until save\r
\x20                                      a name alone shows its value; d is a reading, x a centre, f a fault";

impl fmt::Display for Command {
    /// The line that [`super::command::parse`] reads as this command.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => Ok(()),
            Self::Help => f.write_str("help"),
            Self::HelpEstimator => f.write_str("help estimator"),
            Self::Info => f.write_str("info"),
            Self::Status => f.write_str("status"),
            Self::Distance => f.write_str("distance"),
            Self::Stream(None) => f.write_str("stream"),
            Self::Stream(Some(on)) => write!(f, "stream {}", switch(*on)),
            Self::Black(None) => f.write_str("black"),
            Self::Black(Some(BlackLevel::Shielded)) => f.write_str("black shielded"),
            Self::Black(Some(BlackLevel::Frame)) => f.write_str("black frame"),
            Self::Black(Some(BlackLevel::Fixed(counts))) => write!(f, "black fixed {counts:.0}"),
            Self::Rows(None) => f.write_str("rows"),
            Self::Rows(Some(rows)) => write!(f, "rows {rows}"),
            Self::Mean(None) => f.write_str("mean"),
            Self::Mean(Some(mean)) => write!(f, "mean {}", mean.name()),
            Self::Estimator(None) => f.write_str("estimator"),
            Self::Estimator(Some(estimator)) => write!(f, "estimator {}", estimator.name()),
            Self::Calibration(None) => f.write_str("calibration"),
            Self::Calibration(Some(on)) => write!(f, "calibration {}", switch(*on)),
            Self::Data(offset) => write!(f, "calibration data {offset}"),
            Self::Upload(step) => step.fmt(f),
            Self::Centre => f.write_str("centre"),
            Self::Save => f.write_str("save"),
            Self::Defaults => f.write_str("defaults"),
        }
    }
}

const fn switch(on: bool) -> &'static str {
    if on { "on" } else { "off" }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::centre::Estimator;
    use crate::frame::Mean;
    use crate::protocol::command::parse;
    use crate::protocol::piece::Piece;
    use crate::protocol::upload::Step;
    use crate::units::Counts;

    #[test]
    fn an_answer_is_the_command_that_sets_it() {
        for command in [
            Command::Nothing,
            Command::Help,
            Command::HelpEstimator,
            Command::Info,
            Command::Status,
            Command::Distance,
            Command::Stream(None),
            Command::Stream(Some(true)),
            Command::Stream(Some(false)),
            Command::Black(None),
            Command::Black(Some(BlackLevel::Shielded)),
            Command::Black(Some(BlackLevel::Frame)),
            Command::Black(Some(BlackLevel::Fixed(Counts::from_int(4095)))),
            Command::Rows(None),
            Command::Rows(Some(64)),
            Command::Mean(None),
            Command::Estimator(None),
            Command::Calibration(None),
            Command::Calibration(Some(true)),
            Command::Calibration(Some(false)),
            Command::Data(1360),
            Command::Upload(Step::Begin(1361)),
            Command::Upload(Step::Piece(Piece::new(1360, &[0xE5]).expect("a piece"))),
            Command::Upload(Step::Commit),
            Command::Upload(Step::Abort),
            Command::Centre,
            Command::Save,
            Command::Defaults,
        ]
        .into_iter()
        .chain(Mean::ALL.map(|mean| Command::Mean(Some(mean))))
        .chain(Estimator::ALL.map(|estimator| Command::Estimator(Some(estimator))))
        {
            assert_eq!(parse(command.to_string().as_bytes()), Ok(command));
        }
    }

    #[test]
    fn help_has_every_command() {
        for (name, count) in [
            ("help", 1),
            ("info", 1),
            ("status", 1),
            ("distance", 1),
            ("stream", 1),
            ("rows", 1),
            ("mean", 1),
            ("black", 1),
            ("estimator", 1),
            ("calibration", 4),
            ("centre", 1),
            ("save", 1),
            ("defaults", 1),
        ] {
            let lines = HELP
                .split("\r\n")
                .filter(|line| line.split([' ', '[']).next() == Some(name));
            assert_eq!(lines.count(), count, "{name}");
        }
        assert!(
            HELP.split("\r\n")
                .all(|line| line.len() <= 110 && !line.contains('\n'))
        );
        assert!(HELP.len() + 2 <= crate::protocol::MAX_ANSWER);
    }
}
