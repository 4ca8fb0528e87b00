//! The lines that the program on the chip prints: a kind, a name, then names of values and values. A fault is
//! last.
//!
//! `method phase-table width 10.5 cycles 358 most 371 stack 120`
//!
//! `row phase-table width 10.5 number 3 fault too dim`

use std::collections::BTreeMap;

use anyhow::{Context, Result, ensure};

const KINDS: [&str; 12] = [
    // A function of known cost.
    "known",
    // A method on one row, and over all rows of a width.
    "row",
    "method",
    // Another step of the pipeline.
    "step",
    // A whole row by an estimator, and what makes a reading of a frame.
    "whole-row",
    "reading",
    // A distance at one centre, and a form of a calibration over all centres.
    "distance",
    "form",
    // A peer on one row, and over all rows.
    "peer-row",
    "peer",
    // A function of floats by a library.
    "float",
    // Assembly against its portable twin.
    "kernels",
];

#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    pub kind: String,
    pub name: String,
    pub values: BTreeMap<String, f64>,
    pub fault: Option<String>,
}

impl Line {
    pub fn parse(text: &str) -> Result<Self> {
        Self::read(text).with_context(|| format!("the chip's line {text:?}"))
    }

    fn read(text: &str) -> Result<Self> {
        let mut words = text.split_whitespace();
        let kind = words.next().context("it is empty")?;
        ensure!(KINDS.contains(&kind), "{kind} is no kind of line");
        let name = words.next().context("it has no name")?.to_owned();
        let mut line = Self {
            kind: kind.to_owned(),
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

    pub fn number(&self, key: &str) -> Result<f64> {
        let value = self.values.get(key).copied();
        value.with_context(|| format!("the chip's line about {} does not say {key}", self.name))
    }

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

pub fn all<'a>(lines: &'a [Line], kind: &str) -> impl Iterator<Item = &'a Line> {
    lines.iter().filter(move |line| line.kind == kind)
}

pub fn find<'a>(lines: &'a [Line], kind: &str, name: &str) -> Result<&'a Line> {
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
        assert_eq!((&line.kind[..], &line.name[..]), ("method", "phase-table"));
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
