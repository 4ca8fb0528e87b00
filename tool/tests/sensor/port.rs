//! Without `--port`, the only port is taken where a sensor answers.

use slitrange_tool::sensor::port::PortOption;

use super::stand_in::StandIn;
use crate::command::*;

/// A PC with a sensor at each of its ports.
struct Ports(Vec<StandIn>);

impl Pc for Ports {
    fn open(&self, port: &str) -> serialport::Result<Box<dyn Port + '_>> {
        let sensor = self.0.iter().find(|sensor| sensor.port() == port);
        sensor.expect("a port of the list").open(port)
    }

    fn ports(&self) -> Vec<String> {
        self.0.iter().map(StandIn::port).collect()
    }

    fn now(&self) -> Duration {
        self.0.iter().map(Pc::now).sum()
    }

    fn sleep(&self, time: Duration) {
        self.0.iter().for_each(|sensor| sensor.sleep(time));
    }
}

fn silent(seed: u64) -> StandIn {
    let sensor = StandIn::new(seed);
    sensor.state().trouble.lost = 1.0;
    sensor
}

fn found(pc: &Ports) -> Result<String, String> {
    let found = PortOption::default().find(pc);
    println!("{found:?}");
    found.map_err(|error| format!("{error:#}"))
}

#[test]
fn the_only_sensor_is_found() {
    let gone = StandIn::new(1);
    gone.state().unplug(Duration::from_secs(60));
    let pc = Ports(vec![silent(2), gone, StandIn::new(3)]);
    assert_eq!(found(&pc), Ok(pc.0[2].port()));
    println!("{:?}", pc.now());
    // Four seconds for each port where nobody answers, and two for one that cannot be opened.
    assert!(pc.now() < Duration::from_secs(7));
    // It streams as before.
    assert!(pc.0[2].state().settings().stream);
    let session = PortOption::default().open(&pc).expect("a session");
    assert_eq!(session.port(), pc.0[2].port());
}

#[test]
fn no_sensor_and_several_are_errors_that_name_the_ports() {
    let none = found(&Ports(vec![])).expect_err("no port");
    begins(&none, "this PC has no serial port: ");
    let pc = Ports(vec![silent(1), silent(2)]);
    let silent = found(&pc).expect_err("no sensor");
    begins(&silent, "no sensor is found: check ");
    for port in pc.ports() {
        says(&silent, [format!("\nno sensor answers at {port}")]);
    }
    let pc = Ports([1, 2].map(StandIn::new).into());
    let several = found(&pc).expect_err("two sensors");
    let ports = pc.ports().join(" and at ");
    let error = format!("sensors answer at {ports}: name one of them with --port");
    assert_eq!(several, error);
}
