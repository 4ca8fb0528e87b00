//! The nominal mask: where its slits are.

/// The most slits of a comb.
pub const MAX_SLITS: usize = 16;
/// Width of each slit of the nominal mask, in micrometres: the paper's.
pub const SLIT_WIDTH_UM: i32 = 200;

/// From each slit of the nominal mask to the next, in micrometres.
///
/// The gaps are 0.86 mm or more, so that neighbours see nearly independent speckle and their images stay
/// apart. They are near 0.86, 1.08 and 1.30 mm: these differ by more than speckle moves an image. So the
/// pattern does not repeat: if it is shifted by a slit or more, at most half of the slits fall on others
/// (docs/physics.md).
pub const NOMINAL_GAPS_UM: [i32; MAX_SLITS - 1] = [
    860, 860, 880, 860, 1080, 1300, 1080, 1080, 1080, 860, 1080, 1080, 860, 880, 860,
];

/// Place of the first slit of the nominal mask, in micrometres from the optical axis. At 0.55 m the image of
/// the last slit, and at 1.10 m that of the first one, still lies on a row of 3648 pixels.
const FIRST_UM: i32 = -7900;

/// Places of the nominal mask's slits, in micrometres from the optical axis along the row.
pub const NOMINAL_PLACES_UM: [i32; MAX_SLITS] = {
    let mut places = [FIRST_UM; MAX_SLITS];
    let mut slit = 1;
    while slit < MAX_SLITS {
        places[slit] = places[slit - 1] + NOMINAL_GAPS_UM[slit - 1];
        slit += 1;
    }
    places
};
