//! The PC's side of the serial line, against a sensor that loses, garbles and delays lines, starts anew and
//! goes away.
#![cfg(unix)]

mod demo;
mod flat;
mod front_end;
mod line;
mod monitor;
mod plot;
mod port;
mod row;
mod run;
mod scope;
mod screen;
mod settings;
mod stand_in;
mod transfer;
