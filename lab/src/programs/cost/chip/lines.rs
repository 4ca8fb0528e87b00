//! The lines that the program on the chip prints: a kind, a name, then names of values and values. A fault is
//! last.
//!
//! `method phase-table width 10.5 cycles 358 most 371 stack 120`
//!
//! `row phase-table width 10.5 number 3 fault too dim`

use std::collections::BTreeMap;

use anyhow::{Context, Result, bail, ensure};

/// What a line tells of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A function of known cost.
    Known,
    /// A method on one row.
    Row,
    /// A method over all rows of a width.
    Method,
    /// Another step of the pipeline.
    Step,
    /// A whole row by an estimator.
    WholeRow,
    /// What makes a reading of a frame of an estimator.
    Reading,
    /// A distance at one centre.
    Distance,
    /// A form of a calibration over all centres.
    Form,
    /// A peer on one row.
    PeerRow,
    /// A peer over all rows.
    Peer,
    /// A function of floats by a library.
    Float,
    /// Assembly against its portable twin.
    Kernels,
}

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// What it tells of.
    pub kind: Kind,
    /// Of which.
    pub name: String,
    /// The values, by their names.
    pub values: BTreeMap<String, f64>,
    /// The fault, where there was one.
    pub fault: Option<String>,
}

impl Line {
    /// Reads a line.
    pub fn parse(text: &str) -> Result<Self> {
        Self::read(text).with_context(|| format!("the chip's line {text:?}"))
    }

    fn read(text: &str) -> Result<Self> {
        let mut words = text.split_whitespace();
        let kind = match words.next() {
            Some("known") => Kind::Known,
            Some("row") => Kind::Row,
            Some("method") => Kind::Method,
            Some("step") => Kind::Step,
            Some("whole-row") => Kind::WholeRow,
            Some("reading") => Kind::Reading,
            Some("distance") => Kind::Distance,
            Some("form") => Kind::Form,
            Some("peer-row") => Kind::PeerRow,
            Some("peer") => Kind::Peer,
            Some("float") => Kind::Float,
            Some("kernels") => Kind::Kernels,
            other => bail!("{} is no kind of line", other.unwrap_or("nothing")),
        };
        let name = words.next().context("it has no name")?.to_owned();
        let mut line = Self {
            kind,
            name,
            values: BTreeMap::new(),
            fault: None,
        };
        while let Some(key) = words.next() {
            if key == "fault" {
                let fault: Vec<&str> = words.by_ref().collect();
                ensure!(!fault.is_empty(), "it does not name the fault");
                line.fault = Some(fault.join(" "));
                break;
            }
            let value = words
                .next()
                .with_context(|| format!("{key} has no value"))?;
            let value = value
                .parse()
                .with_context(|| format!("{key} is {value}, no number"))?;
            line.values.insert(key.to_owned(), value);
        }
        Ok(line)
    }

    /// The value of a name.
    pub fn number(&self, key: &str) -> Result<f64> {
        let value = self.values.get(key).copied();
        value.with_context(|| format!("the chip's line about {} does not say {key}", self.name))
    }

    /// The same where it is a whole number.
    pub fn whole(&self, key: &str) -> Result<u64> {
        let value = self.number(key)?;
        ensure!(
            value >= 0.0 && value.fract() == 0.0 && value < 9e15,
            "{key} of {} is {value}, no whole number",
            self.name
        );
        Ok(value as u64)
    }
}

/// All lines of a kind.
pub fn all(lines: &[Line], kind: Kind) -> impl Iterator<Item = &Line> {
    lines.iter().filter(move |line| line.kind == kind)
}

/// The line of a kind about `name`.
pub fn find<'a>(lines: &'a [Line], kind: Kind, name: &str) -> Result<&'a Line> {
    all(lines, kind)
        .find(|line| line.name == name)
        .with_context(|| format!("the chip's program said nothing about {name}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read() {
        let line =
            Line::parse("method phase-table width 10.5 cycles 358 most 371 stack 120").unwrap();
        assert_eq!(
            (line.kind, line.name.as_str()),
            (Kind::Method, "phase-table")
        );
        assert_eq!(line.number("width").unwrap(), 10.5);
        assert_eq!(line.whole("cycles").unwrap(), 358);
        assert!(line.whole("width").is_err());
        assert!(line.number("centre").is_err());
        let line = Line::parse("row robust width 1.5 number 3 fault spot at the edge").unwrap();
        assert_eq!(line.fault.as_deref(), Some("spot at the edge"));
        let line = Line::parse("row blocks width 1.5 number 0 centre -117 uncertainty 4").unwrap();
        assert_eq!((line.number("centre").unwrap(), line.fault), (-117.0, None));
    }

    #[test]
    fn malformed_lines_are_refused() {
        for text in [
            "",
            "method",
            "mathod x",
            "method x width",
            "method x width y",
            "row x fault",
        ] {
            let error = Line::parse(text).unwrap_err();
            assert!(
                format!("{error:#}").contains("the chip's line"),
                "{error:#}"
            );
        }
    }
}
