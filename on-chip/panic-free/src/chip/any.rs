//! Values that the optimiser knows nothing about.

use slitrange::base::exposure::{Exposure, ExposureMode};
use slitrange::base::places::PLACES;
use slitrange::base::units::{Electrons, Units};
use slitrange::centre::WidthClass;
use slitrange::centre::spot_shape::COMPONENTS;
use slitrange::check::own_spot::Profile;
use slitrange::distance::eq1::{Eq1, Eq1Error};
use slitrange::distance::knots::Knot;
use slitrange::distance::residuals::Corrected;
use slitrange::distance::table::Table;
use slitrange::frame::FrameCentre;
use slitrange::frame::comb::{CORRECTIONS, Comb, Combined, MAX_SLITS, SlitMap, Slits};
use slitrange::light::ambient::AmbientMode;
use slitrange::reading::uncertainty::{FittedErrors, FittedSurface, Parts};
use slitrange::row::Background;
use slitrange::row::front_end::{Estimate, FrontEnd};
use slitrange::row::pixels::PixelErrors;
use slitrange::spot::Spot;
use slitrange::spot::choice::SpotChoice;
use slitrange::spot::region::Region;
use slitrange::{
    BlackLevel, Calibration, CalibrationErrors, Counts, Estimator, Fault, Geometry, Mean, Measured,
    Micrometres, Pixels, Polarity, Reading, RowCentre, Surface, sensor_heads,
};
use slitrange_device::filters::average::Average;
use slitrange_device::filters::{Limits, SpikeFilter};
use slitrange_device::record::Record;
use slitrange_device::record::date::Date;
use slitrange_device::settings::Settings;
use slitrange_device::settings::columns::Columns;
use slitrange_device::settings::serial_line::Format;
use slitrange_device::settings::trigger::Trigger;

/// What might be any value of its type, though it is the one given.
pub fn any<T: Copy>(value: T) -> T {
    let place = &raw const value;
    // SAFETY: reads a value that is there, and whose type is free to copy. Volatile: the optimiser may not go
    // by what was written there.
    unsafe { place.read_volatile() }
}

/// As many bytes as the longest record has, or any number that is less.
pub fn bytes(place: &mut [u8; 4096]) -> &mut [u8] {
    *place = any([0; 4096]);
    place.get_mut(..any(0)).unwrap_or_default()
}

/// As many words as the longest row has, or any number that is less.
pub fn words(place: &mut [u16; 4096]) -> &mut [u16] {
    *place = any([0; 4096]);
    place.get_mut(..any(0)).unwrap_or_default()
}

pub fn geometry() -> Geometry {
    Geometry {
        words: any(0),
        shielded: any(0)..any(0),
        light: any(0)..any(0),
        polarity: any(sensor_heads::tcd1304dg().polarity),
        bits: any(0),
        shot_variance_per_count_q16: any(0),
        saturation: any(0),
    }
}

pub fn settings() -> Settings {
    Settings {
        rows: any(0),
        mean: any(Mean::Plain),
        estimator: any(Estimator::Centroid),
        black_level: any(BlackLevel::Shielded),
        slits: any(Slits::Comb),
        ambient: any(AmbientMode::Subtract),
        trigger: any(Trigger::Serial),
        exposure: any(ExposureMode::Auto),
        exposure_limit: any(Exposure::LONGEST),
        laser: any(true),
        region: any(Region::ALL),
        peak: any(SpotChoice::Strongest),
        surface: any(Surface::Auto),
        address: any(0),
        format: any(Format::Text),
        average: any(Average::None),
        hold: any(0),
        spike_filter: any(SpikeFilter::Off),
        limits: any(Limits::Off),
        rate: any(0),
        units: any(Units::Millimetres),
        output: any(Columns::NONE),
        ..Settings::default()
    }
}

pub fn calibration() -> Option<Calibration> {
    match any(0) {
        0 => eq1().ok().map(Calibration::Eq1),
        1 => {
            let table = Table::new(knots(&mut [KNOT; 300]));
            table.ok().map(Calibration::Table)
        }
        _ => {
            let (curve, mut place) = (eq1().ok()?, [KNOT; 300]);
            let corrected = Corrected::new(curve, knots(&mut place));
            corrected.ok().map(Calibration::Corrected)
        }
    }
}

pub fn eq1() -> Result<Eq1, Eq1Error> {
    let pixels = || any(Pixels::MIN);
    Eq1::new(any(Micrometres::MIN), any(0), pixels(), pixels()..=pixels())
}

pub const KNOT: Knot = Knot {
    centre: Pixels::MIN,
    value: Micrometres::MIN,
};

/// More knots than any curve may have, or any number that is less.
pub fn knots(place: &mut [Knot; 300]) -> &[Knot] {
    *place = any([KNOT; 300]);
    place.get(..any(0)).unwrap_or_default()
}

pub fn record(calibration: Calibration) -> Option<Record> {
    Some(Record {
        serial_number: any(0),
        date: Date::new(any(0), any(0), any(0))?,
        geometry: geometry(),
        estimator: any(Estimator::Centroid),
        black_level: any(BlackLevel::Shielded),
        calibration,
        errors: errors(),
        profile: any(true).then(profile),
        comb: comb(),
        front_end: any(true).then(front_end),
    })
}

pub fn front_end() -> FrontEnd {
    let counts = || Estimate {
        value: any(Counts::MIN),
        u: any(Counts::MIN),
    };
    FrontEnd {
        polarity: any(Polarity::Rising),
        gain: Estimate {
            value: any(Electrons::MIN),
            u: any(Electrons::MIN),
        },
        read_noise: counts(),
        saturation: any(true).then(counts),
        black_level: counts(),
    }
}

pub fn profile() -> Profile {
    let places = || any([Pixels::MIN; PLACES]);
    Profile {
        first: any(Pixels::MIN),
        last: any(Pixels::MIN),
        width: places(),
        width_deviation: any(Pixels::MIN),
        components: any([[Pixels::MIN; PLACES]; COMPONENTS]),
        deviation: any(Pixels::MIN),
    }
}

pub fn errors() -> CalibrationErrors {
    let places = || any([Micrometres::MIN; PLACES]);
    if any(true) {
        return CalibrationErrors::Unknown;
    }
    if any(true) {
        return CalibrationErrors::Nominal;
    }
    CalibrationErrors::Fitted(FittedErrors {
        curve: places(),
        surface: any(true).then(|| FittedSurface {
            deviation: places(),
            height: any([Counts::MIN; PLACES]),
        }),
    })
}

pub fn spot() -> Spot {
    any(Spot {
        centre: 0,
        block_log2: 0,
        height: Counts::MIN,
        background: Background {
            level: Counts::MIN,
            noise: Counts::MIN,
        },
        black_level: Counts::MIN,
    })
}

pub fn row_centre() -> RowCentre {
    any(RowCentre {
        centre: Pixels::MIN,
        uncertainty: Pixels::MIN,
        amplitude: Counts::MIN,
        width: Pixels::MIN,
        class: WidthClass::default(),
        shape: any::<slitrange::centre::spot_shape::SpotShape>(Default::default()),
        misfit: false,
    })
}

pub fn exposure() -> Option<Exposure> {
    any(Some(Exposure::LONGEST))
}

pub fn measured() -> Measured {
    any(Measured {
        frame: FrameCentre {
            centre: Pixels::MIN,
            uncertainty: Pixels::MIN,
            amplitude: Counts::MIN,
            exposure: exposure(),
            width: Pixels::MIN,
            rows_used: 0,
            rows: 0,
            shape: any::<slitrange::centre::spot_shape::SpotShape>(Default::default()),
            misfits: 0,
            correlated: None,
            spread: Pixels::default(),
            motion: Pixels::default(),
        },
        black_level: Counts::MIN,
        ambient: Counts::default(),
        estimator: Estimator::Centroid,
        by_shape: any(Pixels::MIN),
        pixels: PixelErrors::TCD1304DG,
        comb: any(true).then(|| any(COMBINED)),
    })
}

pub fn reading() -> Reading {
    any(Reading {
        distance: Micrometres::MIN,
        uncertainty: Micrometres::MIN,
        centre: Pixels::MIN,
        centre_uncertainty: Pixels::MIN,
        amplitude: Counts::MIN,
        exposure: exposure(),
        width: Pixels::MIN,
        rows_used: 0,
        slits_used: any(0),
        rows: 0,
        black_level: Counts::MIN,
        estimator: Estimator::Centroid,
        misfits: 0,
        correlated: None,
        parts: Parts::default(),
        is_nominal: false,
        has_other_settings: false,
    })
}

pub fn fault() -> Fault {
    any(Fault::SensorSilent)
}

const COMBINED: Combined = Combined {
    shift: Pixels::MIN,
    surface: Pixels::MIN,
    used: 0,
    centres: [None; MAX_SLITS],
};

pub fn comb() -> Option<Comb> {
    let mut slits = [SlitMap::nominal(0); 20];
    for slit in &mut slits {
        *slit = SlitMap::nominal(any(0)).corrected(any([Pixels::MIN; CORRECTIONS]));
    }
    Comb::new(slits.get(..any(0))?)
}
