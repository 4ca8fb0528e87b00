//! The kinds of faults.

use crate::second_judge::Rng;
use crate::second_judge::plan::Plan;
use crate::second_judge::{
    beside, front_end, lopsided, moving, optics, pixels, signal, target, words,
};

/// Which parts of u a kind's errors are compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Claim {
    /// The centre's own: its noise (r), the spot's shape and the motion.
    Centre,
    /// Also the part for pixels that differ.
    CentreAndPixels,
}

/// One kind of fault.
#[derive(Clone, Copy)]
pub struct Kind {
    /// Its name.
    pub name: &'static str,
    /// What it is, with its strengths. *sigma* is the spot's width.
    pub what: &'static str,
    /// Which parts of u its errors are compared with.
    pub claim: Claim,
    /// Draws the fault and puts it into a plan.
    pub(super) put: fn(&mut Plan, &mut Rng),
}

impl Kind {
    /// All kinds.
    pub const fn all() -> &'static [Self] {
        &KINDS
    }

    /// Finds a kind by its name.
    pub fn named(name: &str) -> Option<&'static Self> {
        KINDS.iter().find(|kind| kind.name == name)
    }
}

macro_rules! kinds {
    ($($name:literal $claim:ident $put:path, $what:literal;)+) => {
        [$(Kind { name: $name, what: $what, claim: Claim::$claim, put: $put }),+]
    };
}

const KINDS: [Kind; 53] = kinds! {
    "clean" Centre target::clean,
        "nothing is wrong";
    "moving target" Centre target::moves,
        "the spot moves 0.02 to 0.6 px from row to row";
    "faint wide light" Centre target::hump,
        "20 to 100 counts with sigma 200 to 400 px beside a spot of 60 to 400 counts";
    "faint wide light alone" Centre target::hump_alone,
        "the same without a spot";
    "dark" Centre target::dark,
        "no spot: noise, and up to 100 counts of even light";
    "saturated" Centre target::saturated,
        "the spot is 1.05 to 4 times as high as full scale";
    "row's edge" Centre target::edge,
        "the centre is between 1 sigma beyond the row's end and 5 sigma inside";
    "two like spots" Centre target::two_like,
        "heights of 0.85 to 1.15, 4 to 30 sigma apart: any centre is wrong";
    "second reflection" Centre target::second_reflection,
        "0.2 to 0.75 of the height, 1.5 to 6 sigma off, 0.8 to 1.5 times as wide";
    "donut" Centre target::donut,
        "a symmetric hole in the spot: 20 to 95 % deep, 0.2 to 0.6 sigma wide";
    "dust, wide shadow" Centre optics::dust_wide,
        "a shadow with a width of 0.5 to 1.5 sigma on one flank, 5 to 60 % deep";
    "dust, narrow shadow" Centre optics::dust_narrow,
        "a shadow with a width of 0.2 to 0.5 sigma on one flank, 5 to 90 % deep";
    "speckle grain" Centre optics::grain,
        "grain of 5 to 40 % contrast and 0.1 to 0.5 sigma in the spot";
    "weak ghost" Centre optics::weak_ghost,
        "1 to 6 % of the height, 1 to 5 sigma off, 0.8 to 2 times as wide";
    "etalon fringes" Centre optics::fringes,
        "the cover glass modulates the light by 1 to 8 %, with a period of 5 to 40 px";
    "halo" Centre optics::halo,
        "2 to 30 % of the height about the spot, 2.5 to 10 times as wide";
    "veil" Centre optics::veil,
        "1 to 20 % of the height, 3 to 10 times as wide, up to 6 sigma off";
    "wide lamp" Centre optics::lamp,
        "5 to 60 % of the height, 2.5 to 15 times as wide, up to 2 of its widths off";
    "blooming tail" Centre pixels::blooming_tail,
        "the well is 5 to 60 % too small, 2 to 30 % of the rest leaks to one side over 1 to 15 px";
    "lag" Centre pixels::lag,
        "1 to 8 % of the row before, when the spot was 0.1 to 2 sigma elsewhere, and before that";
    "hot block" Centre pixels::hot_block,
        "1 to 4 pixels within 3 sigma leak 30 to 3000 counts";
    "dead block" Centre pixels::dead_block,
        "1 to 6 pixels within 3 sigma are dark";
    "stuck pixel" Centre pixels::stuck,
        "a pixel within 3 sigma always reads the same";
    "uneven dark pixels" CentreAndPixels pixels::uneven_dark,
        "the pixels' offsets differ by 1 to 8 counts (standard deviation)";
    "uneven response" CentreAndPixels pixels::uneven_response,
        "the pixels' responses differ by 0.3 to 4 % (standard deviation)";
    "odd and even pixels" Centre pixels::odd_even,
        "every other pixel has up to 6 % more gain and up to 20 counts more";
    "sloping black level" Centre signal::slope,
        "the level rises by 0.02 to 2 counts a pixel";
    "black level clipped on one side" Centre signal::clipped,
        "the level falls by 0.05 to 3 counts a pixel, to below zero from 4 sigma before the spot on";
    "step of the black level" Centre signal::step,
        "3 to 60 counts within 3 sigma of the centre";
    "mains flicker" Centre signal::flicker,
        "a lamp of 20 to 600 counts goes on and off at 100 Hz, brighter at one end of the row";
    "ripple" Centre signal::ripple,
        "0.5 to 12 % of the height, with a period of 4 to 150 px";
    "burst" Centre signal::burst,
        "an oscillation of 3 to 25 % of the height with a period of 2 to 20 px, as long as 0.5 to 3 sigma";
    "slow noise" Centre signal::slow_noise,
        "noise of 0.5 to 4 times the read noise that lasts 3 to 60 px";
    "impulses" Centre signal::impulses,
        "0.1 to 3 % of a row's pixels read anything";
    "missing codes" Centre words::missing_codes,
        "the converter skips 2 to 24 codes at each multiple of 32 to 512";
    "word lost in the spot" Centre words::lost_word,
        "a word within 3 sigma of the centre is lost: the next ones move up";
    "rows slip" Centre words::slip,
        "1 to 6 of 16 rows begin 1 to 60 words late; a single row has nothing to tell it by";
    "lost clock" Centre words::lost_clock,
        "from a pixel on, the words are shifted by 1 to 3 bits";
    "spot beside wider light" Centre beside::wider_light,
        "light with sigma 30 to 170 px elsewhere on a row of 3648 px; a spot of 60 to 3000 counts, 1.35 to 5 \
         times as high";
    "narrow spot on a wide lamp" Centre beside::wide_lamp,
        "sigma 2 to 8 px, 300 to 3000 counts; the lamp: 0.3 to 0.7 of the height, sigma 60 to 150 px, up to \
         2 of its widths off";
    "weak ghost and outliers" Centre optics::ghost_and_outliers,
        "2 to 5 % of the height, 0.8 to 2 sigma off; in 3 to 6 of 16 rows the spot jumps by 0.5 to 3 sigma, \
         or 1 to 4 of its pixels get 300 to 1000 counts more";
    "dim spot beside a hump" Centre beside::hides_dim_spot,
        "20 to 100 counts with sigma 150 to 180 px; a spot of 60 to 200 counts on a row of 3648 px";
    "narrow sinc^2" Centre target::narrow_sinc2,
        "nothing is wrong: spots of a slit; the gaussian that fits best has sigma 1.2 to 1.5 px";
    "edge of the reflectivity" Centre lopsided::reflectivity,
        "beyond an edge within 1.5 sigma of the centre the light is 0.2 to 0.8 times as bright; the edge is \
         blurred by 0.1 to 0.4 sigma";
    "laser of two lobes" Centre lopsided::two_lobes,
        "two gaussians, heights 1 and 0.3 to 0.9, 0.6 to 1.6 sigma apart";
    "mode hop" Centre moving::mode_hop,
        "from a row on the spot is 0.05 to 1 sigma elsewhere";
    "video echo" Centre front_end::echo,
        "each pixel gets 2 to 15 % of what the pixel 1 to 3 before it shows, added or taken away";
    "translucent target" Centre lopsided::translucent,
        "5 to 50 % of the light is an exponential tail to one side, with a length of 0.5 to 4 sigma";
    "old pixels" Centre moving::old_pixels,
        "every other pixel shows the row before, when the spot was 0.1 to 1 sigma elsewhere; in a frame a \
         tenth of this";
    "glass plate" Centre lopsided::glass_plate,
        "a second spot of 0.9 to 1.1 of the height, 0.8 to 2.5 sigma off; only the width tells of it";
    "vibration" Centre moving::vibration,
        "the spot swings by 0.3 to 2 px to each side, 0.3 to 3 times in 16 rows";
    "uneven dark pixels and response" CentreAndPixels pixels::uneven_both,
        "responses differ by 0.5 to 2 %, offsets by 2 or 5 counts (standard deviations)";
    "few photons on a pedestal" Centre beside::few_photons,
        "a spot of 30 to 200 counts, 4 to 12 electrons a count; the pedestal: 0.2 to 2 times the height, 10 \
         to 40 times as wide";
};
