//! Tests of scenes and studies. They are in the library, so that `cargo test` compiles it only once.

mod scenes;
mod slowest;
mod surfaces;
mod surfaces_on_board;
mod table1;
