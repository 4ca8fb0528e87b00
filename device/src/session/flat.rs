//! What the session knows of the map of the pixels. The map itself is with the owner of the session.

use super::Actions;
use crate::protocol::flat::{Flat, FlatAnswer, Remaining};
use crate::protocol::refusal::Refusal;
use crate::store::StoreError;
use crate::store::pixel_map::StoredMap;
use slitrange::row::pixels::flat_field::{Kind, TakeError, Taken};
use slitrange::row::pixels::map::MapSummary;

/// What the owner of the session must do with the map, and then report with an [`Outcome`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Job {
    /// Read the map from flash.
    Load,
    /// Take rows for a map. No frame is due meanwhile.
    Take(Kind),
    /// Write the map to flash. No frame is due meanwhile.
    Save,
    /// Erase the map in flash and forget it. No frame is due meanwhile.
    Erase,
    /// Correct rows with the map, or do not. Needs no report.
    Use(bool),
}

/// How a [`Job`] ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Flash was read. Holds what the map says, if flash had a usable one.
    Loaded(Result<StoredMap, StoreError>, Option<MapSummary>),
    /// Rows were taken.
    Taken(Kind, Result<Taken, TakeError>),
    /// The map was written.
    Saved(Result<(), StoreError>),
    /// The map was erased.
    Erased(Result<(), StoreError>),
}

#[derive(Clone, Debug, Default)]
pub(super) struct FlatState {
    map: Option<MapSummary>,
    /// Whether rows are to be corrected with the map.
    pub(super) is_on: bool,
    has_dark_rows: bool,
    stored: StoredMap,
    is_stored: bool,
    /// Whether the owner is to load the map because of `flat on`.
    is_asked: bool,
}

impl FlatState {
    pub(super) fn execute(&mut self, flat: Flat, actions: &mut Actions) -> Result<(), Refusal> {
        let mut pause = |job| {
            actions.flat = Some(job);
            actions.add_line(&format_args!("{flat} pauses the stream"));
        };
        match flat {
            Flat::Show => actions.add_line(&FlatAnswer {
                map: self.map.as_ref(),
                is_on: self.is_on,
                has_dark_rows: self.has_dark_rows && self.map.is_none(),
                stored: self.stored,
                is_stored: self.is_stored,
            }),
            Flat::Take(Kind::Lit) if !self.has_dark_rows => {
                return Err(Refusal::NotTaken(TakeError::NoDark));
            }
            Flat::Take(kind) => pause(Job::Take(kind)),
            Flat::Save => {
                self.map.ok_or(Refusal::NoMap)?;
                pause(Job::Save);
            }
            Flat::Use(true) if self.map.is_none() => {
                if !matches!(self.stored, StoredMap::Newest | StoredMap::Older) {
                    return Err(Refusal::NoMap);
                }
                // Dark rows took the place of the map.
                self.is_asked = true;
                actions.flat = Some(Job::Load);
            }
            Flat::Use(is_on) => {
                self.map.ok_or(Refusal::NoMap)?;
                self.is_on = is_on;
                actions.flat = Some(Job::Use(is_on));
                actions.add_line(&flat);
            }
            Flat::Erase => pause(Job::Erase),
        }
        Ok(())
    }

    /// Takes the report of a job.
    pub(super) fn end(&mut self, outcome: Outcome, actions: &mut Actions) {
        if let Err(refusal) = self.take(outcome, actions) {
            actions.add_line(&refusal);
        }
    }

    fn take(&mut self, outcome: Outcome, actions: &mut Actions) -> Result<(), Refusal> {
        match outcome {
            Outcome::Loaded(stored, map) => {
                self.stored = stored.unwrap_or(StoredMap::Unusable);
                self.map = map;
                self.is_on = map.is_some();
                self.is_stored = map.is_some();
                self.has_dark_rows = false;
                if core::mem::take(&mut self.is_asked) {
                    map.ok_or(Refusal::NoMap)?;
                    actions.add_line(&Flat::Use(true));
                }
            }
            Outcome::Taken(kind, taken) => {
                let Taken { mean, map } = taken.map_err(Refusal::NotTaken)?;
                self.map = map;
                self.is_on = map.is_some();
                self.is_stored = false;
                // They stay for other lit rows: an answer that was lost is asked for again.
                self.has_dark_rows = true;
                let flat = Flat::Take(kind);
                match map {
                    None => actions.add_line(&format_args!("{flat} {mean} counts")),
                    Some(map) => actions.add_line(&format_args!(
                        "{flat} {mean} counts {} outside {}",
                        Remaining(map.errors),
                        map.outside
                    )),
                }
            }
            Outcome::Saved(saved) => {
                saved.map_err(Refusal::MapNotSaved)?;
                self.stored = StoredMap::Newest;
                self.is_stored = true;
                actions.add_line(&Flat::Save);
            }
            Outcome::Erased(erased) => {
                // A failure may leave one of two maps.
                self.map = None;
                self.is_on = false;
                self.is_stored = false;
                self.has_dark_rows = false;
                self.stored = StoredMap::Unusable;
                erased.map_err(Refusal::MapNotSaved)?;
                self.stored = StoredMap::Nothing;
                actions.add_line(&Flat::Erase);
            }
        }
        Ok(())
    }
}
