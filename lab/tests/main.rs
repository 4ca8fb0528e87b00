//! The pages and scenes that the programs write and read.

mod hard_cases_page;
mod scenes;
mod slowest;
mod surfaces;
mod surfaces_on_board;
mod table1;
