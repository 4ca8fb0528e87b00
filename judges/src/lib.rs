//! What judges the core on a PC: seeded rows, reference values in f64, and the errors of the core's answers.
//! The tests and the lab's programs share these modules:
//!
//! * [`core_tables`]: phase tables made on the PC, as the core reads them.
//! * [`measured_profile`]: the profile of a spot, measured on rows.
//! * [`accuracy`]: the errors of the estimators on clean rows, compared with the Cramér-Rao bound.
//! * [`float_functions`]: other functions for e^x in the fit, and how far they move a centre.
//! * [`frames`]: frames of a simulated scene, from words to a reading.
//! * [`longest`]: the parts of the longest record.
//! * [`changing_light`]: a sensor with auto exposure before a target whose brightness changes.
//! * [`hard_cases`]: the first judge: a catalogue of hard rows, frames and calibrations, and random mixtures.
//! * [`second_judge`]: the second judge: faults from a generator that shares no code with the first.
#![forbid(unsafe_code)]

// A module uses those before it (host-tests/tests/floors.rs). The blank lines keep rustfmt from sorting them.
pub mod core_tables;

pub mod measured_profile;

pub mod accuracy;

pub mod float_functions;

pub mod frames;

pub mod longest;

pub mod changing_light;

pub mod hard_cases;

pub mod second_judge;
