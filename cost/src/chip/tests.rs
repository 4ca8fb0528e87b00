//! The chip and a PC.
