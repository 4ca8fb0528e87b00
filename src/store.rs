//! What a sensor keeps over a power cycle, in two sectors of flash.

pub mod saved;
