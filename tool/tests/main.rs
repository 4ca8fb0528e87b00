//! Tests of the owner's tool: one test program, so that it links only once.

mod command;
mod design;
mod desk;
mod doctor;
mod end_to_end;
mod fit;
mod recording;
mod replay;
mod sensor;
