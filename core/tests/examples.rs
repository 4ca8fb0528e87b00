//! Runs the examples, which assert their results.

#[path = "../examples/frame_to_distance.rs"]
mod frame_to_distance;
#[path = "../examples/other_sensor.rs"]
mod other_sensor;
#[path = "../examples/row_to_centre.rs"]
mod row_to_centre;

#[test]
fn a_row_becomes_a_centre() {
    row_to_centre::main();
}

#[test]
fn a_frame_becomes_a_distance_or_a_fault() {
    frame_to_distance::main();
}

#[test]
fn a_sensor_of_another_geometry_measures() {
    other_sensor::main();
}
