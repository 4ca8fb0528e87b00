//! What both sensor heads must do. Each test runs with the TCD1304DG and with the S11639.

use std::time::Duration;

use virtual_board::{Row, Sensor};

use crate::common::{Status, boot_with, paper_for};

fn reads(sensor: Sensor) {
    let (mut board, banner) = boot_with(sensor, paper_for(sensor));
    println!("{}", banner.text);
    board.head(|head| head.keep_all_rows(true));
    board.run_for(Duration::from_millis(500)).expect("a run");
    let lines = board.take_lines();
    for line in lines.iter().take(8) {
        println!("{}", line.text);
    }
    let rows: Vec<Row> = board.head(|head| head.rows().cloned().collect());
    for row in rows.iter().take(5) {
        println!("{} {:?} {:?} {:?}", row.lead_in, row.phase, row.exposure, row.read_out);
    }
    println!("{} rows, {:#?}", rows.len(), Status::ask(&mut board));
    board.finish().expect("a clean run");
}

#[test]
fn reads_s11639() {
    reads(Sensor::S11639);
}
