//! What a person does about a fault, with the settings that may help.

use slitrange::base::fault::Fault;

/// What to do about a fault.
pub const fn advice(fault: &Fault) -> &'static str {
    match fault {
        Fault::SensorSilent => "check the sensor head's supply and wires",
        Fault::NoSpot { .. } => {
            "check that the laser is on and hits a target, and that the exposure is long enough"
        }
        Fault::LaserOff => "send `laser on`",
        Fault::Spike { .. } => {
            "look for what disturbs the light; if the target moves as fast, a larger `spike-filter`"
        }
        Fault::TooDim { .. } => {
            "a longer exposure, more laser power, a brighter target or less ambient light"
        }
        Fault::Saturated { .. } => "a shorter exposure, less laser power or a darker target",
        Fault::DimAtLongest { .. } => {
            "a longer `exposure limit`, more laser power, a brighter target or less ambient light"
        }
        Fault::SaturatedAtShortest { .. } => {
            "less laser power or a darker target, or cover other lights"
        }
        Fault::SpotAtEdge { .. } | Fault::OutOfRange { .. } => {
            "move the target into the range that `info` names"
        }
        Fault::TwoSpots { .. } => {
            "cover other lights, and surfaces that reflect the laser, or set `region` or `peak`"
        }
        Fault::Unsteady { .. } => "hold the target still, or take fewer rows in a frame",
        Fault::FewSlits { .. } => {
            "clean the slits, take more light, or send `slits one` if there is no comb"
        }
        Fault::SlitsUnclear { .. } => "cover other lights, and surfaces that reflect the laser",
        Fault::NotCalibrated { .. } => {
            "send `calibration on`; without a calibration, upload one, or send `defaults` \
             (TCD1304DG only)"
        }
    }
}
