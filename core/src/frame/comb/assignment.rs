//! Tells which peak belongs to which slit.
//!
//! A peak through a slit says where a slit on the axis would show the spot: x0. If all peaks are given to
//! their own slits, all say the same x0. The gaps between the slits differ, so any other way of giving peaks
//! to slits brings fewer of them together, and those lie farther apart. Each slit with a peak near its place
//! adds 1 - (off / tolerance)^2 to the score of an x0. The highest score wins, if it wins clearly.

use core::cell::Cell;

use heapless::Vec;

use crate::base::{Fault, Pixels, numeric, order_statistic};
use crate::frame::comb::{Comb, MAX_MAXIMA, MAX_SLITS, Maximum};
use crate::row::MAX_PIXELS;

/// The fewest slits that make a measurement: with fewer, their scatter says little of the error, and noise
/// or reflections might agree by chance.
pub const FEWEST: usize = 4;
/// The score of the best x0 must exceed that of any other by so much: one false peak adds at most 1.
pub const LEAD: f32 = 1.5;
/// An image may be so far from its place, in pixels: 4.5 times what speckle of a 1 mm spot on metal does (2.7
/// px RMS at 0.8 m).
pub const TOLERANCE: f32 = 12.0;
/// Pixels in a bin of x0, and bins that agree: twice the tolerance.
const BIN: f32 = 8.0;
const AGREEING: usize = 3;

/// A peak within [`TOLERANCE`] of its slit's place says an x0 that is at most so many bins off: images move
/// by at least half as much as x0. (Corrections of some pixels change that little.)
const REACH: usize = 3;
/// Bins for the x0 of a row.
const BINS: usize = MAX_PIXELS / numeric::whole_usize(BIN);

/// Which peak belongs to which slit.
#[derive(Clone, Debug, PartialEq)]
pub struct Assignment {
    /// Where a slit on the axis would show the spot: the median over the slits.
    pub x0: Pixels,
    /// The peak of each slit, by its number in the list of peaks.
    pub peaks: [Option<usize>; MAX_SLITS],
}

impl Assignment {
    /// The number of slits that have a peak.
    pub fn slits(&self) -> usize {
        numeric::count(self.peaks.iter().map(Option::is_some))
    }
}

/// Gives the peaks to the slits.
///
/// # Errors
/// [`Fault::FewSlits`] if fewer than [`FEWEST`] slits agree. [`Fault::SlitsUnclear`] if this place does not
/// lead by [`LEAD`].
pub fn assign(peaks: &[Maximum], comb: &Comb) -> Result<Assignment, Fault> {
    let mut candidates = Candidates::NONE;
    candidates.add_all(peaks, comb);
    let bounds = candidates.bounds();
    let (mut first, mut most) = (0, 0);
    for ((place, votes), &bound) in (0..BINS)
        .zip(candidates.votes.windows(AGREEING))
        .zip(&bounds)
    {
        if bound > most {
            let slits = agreeing(votes);
            if slits > most {
                (first, most) = (place, slits);
            }
        }
    }
    if usize::from(most) < FEWEST {
        return Err(few(most.into()));
    }
    // The window with the most votes first: after it the bound skips most others.
    let Some(x0) = candidates.median_in(first) else {
        return Err(few(0));
    };
    let mut best = Scored::of(peaks, comb, x0);
    for (place, &bound) in (0..BINS).zip(&bounds) {
        if f32::from(bound) > best.score
            && let Some(x0) = candidates.median_in(place)
            && x0 != best.x0
        {
            let this = Scored::of(peaks, comb, x0);
            if this.score > best.score {
                best = this;
            }
        }
    }
    if best.slits < FEWEST {
        return Err(few(best.slits));
    }
    // The best score elsewhere counts if it comes within the lead. Windows that overlap hold the same x0.
    let mut other = Scored::NONE;
    for (place, &bound) in (0..BINS).zip(&bounds) {
        let bound = f32::from(bound);
        if bound > best.score - LEAD
            && bound > other.score
            && !is_around(place, best.x0)
            && let Some(x0) = candidates.median_in(place)
            && (x0.to_f32() - best.x0.to_f32()).abs() > 2.0 * TOLERANCE
        {
            let this = Scored::of(peaks, comb, x0);
            if this.score > other.score {
                other = this;
            }
        }
    }
    if best.score - other.score >= LEAD {
        return Ok(Assignment {
            x0: best.x0,
            peaks: nearest(peaks, comb, best.x0).map(|near| near.map(|(peak, _)| peak)),
        });
    }
    if other.slits == 0 {
        // Nothing fits elsewhere, and hardly anything here.
        return Err(few(best.slits));
    }
    Err(Fault::SlitsUnclear {
        images: numeric::to_u16(best.slits),
        other: numeric::to_u16(other.slits),
    })
}

/// Whether a window of bins lies within twice the tolerance of an x0.
fn is_around(first: usize, x0: Pixels) -> bool {
    // Bins are few.
    let start = first as f32 * BIN;
    let end = start + AGREEING as f32 * BIN;
    let x0 = x0.to_f32();
    x0 - start <= 2.0 * TOLERANCE && end - x0 <= 2.0 * TOLERANCE
}

/// How well the peaks fit the slits for an x0.
struct Scored {
    x0: Pixels,
    score: f32,
    slits: usize,
}

impl Scored {
    const NONE: Self = Self {
        x0: Pixels::MIN,
        score: 0.0,
        slits: 0,
    };

    fn of(peaks: &[Maximum], comb: &Comb, x0: Pixels) -> Self {
        let (mut score, mut slits) = (0.0, 0);
        for (_, off) in nearest(peaks, comb, x0).into_iter().flatten() {
            score += 1.0 - (off / TOLERANCE) * (off / TOLERANCE);
            slits = numeric::add_usize(slits, 1);
        }
        Self { x0, score, slits }
    }
}

pub(super) fn few(found: usize) -> Fault {
    Fault::FewSlits {
        found: numeric::to_u16(found),
        needed: numeric::to_u16(FEWEST),
    }
}

/// The number of slits that have a vote in some bins.
fn agreeing(votes: &[u16]) -> u8 {
    slits_in(votes.iter().fold(0, |all, votes| all | votes))
}

fn slits_in(votes: u16) -> u8 {
    (votes.count_ones() & 0xff) as u8
}

/// Adds to each bin the votes of the bin that is so many bins ahead.
fn add_from(ahead: usize, votes: &mut [u16]) {
    let votes = Cell::from_mut(votes).as_slice_of_cells();
    let from = votes.get(ahead..).unwrap_or_default();
    for (votes, from) in votes.iter().zip(from) {
        votes.set(votes.get() | from.get());
    }
}

/// What each peak says of x0 through each slit, by bins. Computed once, because it takes longer than all the
/// rest.
struct Candidates {
    /// The slits that may have their image in a bin, a bit for each.
    votes: [u16; BINS],
    /// The bits of each x0, and the number of the one before it in its bin. Bits of positive numbers are in
    /// the order of the numbers.
    all: Vec<(u32, u16), { MAX_MAXIMA * MAX_SLITS }>,
    /// The number of the last x0 in each bin. Numbers begin with 1; 0 is none.
    last: [u16; BINS],
}

impl Candidates {
    const NONE: Self = Self {
        votes: [0; BINS],
        all: Vec::new(),
        last: [0; BINS],
    };

    /// Adds what the peaks say through each slit.
    fn add_all(&mut self, peaks: &[Maximum], comb: &Comb) {
        for (slit, number) in comb.slits().iter().zip(0..numeric::to_u32(MAX_SLITS)) {
            let to_axis = slit.roughly_to_axis();
            let bit = 1u16.wrapping_shl(number);
            for peak in peaks {
                self.add(to_axis(peak.place), bit);
            }
        }
    }

    /// Adds what a peak says through the slit with this bit.
    fn add(&mut self, x0: f32, slit: u16) {
        let bin = numeric::whole_usize(x0 * (1.0 / BIN));
        // Beyond the row there is no such bin. There is room for all peaks of all slits.
        if x0 > 0.0
            && let (Some(votes), Some(last)) = (self.votes.get_mut(bin), self.last.get_mut(bin))
            && self.all.push((x0.to_bits(), *last)).is_ok()
        {
            *votes |= slit;
            *last = numeric::to_u16(self.all.len());
        }
    }

    /// The score that each window of bins can have at most: each slit adds at most 1, and has a peak in the
    /// window or within [`REACH`] bins of it. In the first and the last [`REACH`] windows the score may
    /// exceed this bound, because an x0 off the row has no vote. No target is seen there.
    fn bounds(&self) -> [u8; BINS] {
        let mut votes = [0; REACH + BINS];
        if let Some(own) = votes.get_mut(REACH..) {
            own.copy_from_slice(&self.votes);
        }
        // A bin then holds the votes of 2, 4, 8 and 9 bins from it on: those of its window and in reach.
        for ahead in [1, 2, 4, 1] {
            add_from(ahead, &mut votes);
        }
        let mut bounds = [0; BINS];
        for (bound, votes) in bounds.iter_mut().zip(votes) {
            *bound = slits_in(votes);
        }
        bounds
    }

    fn median_in(&self, first: usize) -> Option<Pixels> {
        let mut keys: Vec<u32, { 2 * MAX_MAXIMA }> = Vec::new();
        for &last in self.last.get(first..first.saturating_add(AGREEING))? {
            let mut next = last;
            // Each number is lower than the one before.
            while let Some(&(key, before)) = numbered(&self.all, next) {
                // A peak is in the window for one slit: gaps are longer than windows. If a comb has shorter
                // ones, the last of them count.
                let _ = keys.push(key);
                next = before;
            }
        }
        let median = order_statistic::ranked(keys.len() / 2, &keys)?;
        Some(Pixels::from_f32(f32::from_bits(median)))
    }
}

/// The x0 with a number from 1.
fn numbered(all: &[(u32, u16)], number: u16) -> Option<&(u32, u16)> {
    all.get(usize::from(number).checked_sub(1)?)
}

/// The peak nearest to where each slit shows x0, and how far it is, if it is within [`TOLERANCE`]. No two
/// slits have the same peak.
fn nearest(peaks: &[Maximum], comb: &Comb, x0: Pixels) -> [Option<(usize, f32)>; MAX_SLITS] {
    let mut all = [None; MAX_SLITS];
    // A bit for each peak that a slit has.
    let mut taken = 0u32;
    for (place, slit) in all.iter_mut().zip(comb.slits()) {
        let expected = slit.from_axis(x0).to_f32();
        let mut least = TOLERANCE;
        for (number, peak) in (0..MAX_MAXIMA).zip(peaks) {
            let off = (peak.place - expected).abs();
            if off <= least && taken & 1u32.wrapping_shl(numeric::to_u32(number)) == 0 {
                (least, *place) = (off, Some((number, off)));
            }
        }
        if let Some((number, _)) = *place {
            taken |= 1u32.wrapping_shl(numeric::to_u32(number));
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::units::Counts;

    fn peak(place: f32) -> Maximum {
        Maximum {
            place,
            height: Counts::from_int(1000),
        }
    }

    /// The peaks of all slits of a comb but some, for a spot at x0.
    fn peaks(comb: &Comb, x0: f32, but: &[usize]) -> std::vec::Vec<Maximum> {
        let slits = (0..)
            .zip(comb.slits())
            .filter(|(slit, _)| !but.contains(slit));
        slits
            .map(|(_, slit)| peak(slit.from_axis(Pixels::from_f32(x0)).to_f32()))
            .collect()
    }

    #[test]
    fn each_slit_gets_its_own_peak() {
        let comb = Comb::nominal();
        let x0 = [1191.0, 1823.5, 2654.0].into_iter();
        for x0 in x0.take(if cfg!(miri) { 1 } else { 3 }) {
            for but in [
                &[] as &[usize],
                &[0, 15],
                &[1, 3, 5, 7, 9, 11, 13, 15],
                &[0, 1, 2, 3, 4, 5],
            ] {
                let found = assign(&peaks(&comb, x0, but), &comb).expect("an assignment");
                assert!((found.x0.to_f32() - x0).abs() < 0.01);
                let mut next = 0;
                for slit in 0..MAX_SLITS {
                    let expected = (!but.contains(&slit)).then_some(next);
                    assert_eq!(found.peaks[slit], expected, "slit {slit} at {x0}");
                    next += usize::from(expected.is_some());
                }
            }
        }
    }

    /// A window that is not looked at could not have won.
    #[test]
    #[cfg_attr(miri, ignore = "`each_slit_gets_its_own_peak` runs the same code")]
    fn no_score_exceeds_its_bound() {
        let comb = Comb::nominal();
        let mut state = 1;
        let mut tightest = f32::MAX;
        for _ in 0..200 {
            let peaks: [Maximum; 24] =
                core::array::from_fn(|_| peak(3648.0 * crate::tests::uniform(&mut state)));
            let mut candidates = Candidates::NONE;
            candidates.add_all(&peaks, &comb);
            let bounds = candidates.bounds().into_iter().enumerate();
            for (place, bound) in bounds.skip(REACH).take(BINS - AGREEING - 2 * REACH) {
                if let Some(x0) = candidates.median_in(place) {
                    let left = f32::from(bound) - Scored::of(&peaks, &comb, x0).score;
                    assert!(left >= 0.0, "{place}");
                    tightest = tightest.min(left);
                }
            }
        }
        println!("the tightest bound is {tightest:.3} above its score");
    }

    #[test]
    #[cfg_attr(miri, ignore = "`each_slit_gets_its_own_peak` runs the same code")]
    fn too_few_peaks_and_peaks_of_no_comb_are_faults() {
        let comb = Comb::nominal();
        let some = peaks(&comb, 1823.5, &[]);
        assert_eq!(assign(&[], &comb), Err(few(0)));
        for number in 1..FEWEST {
            assert_eq!(assign(&some[..number], &comb), Err(few(number)));
        }
        // Even gaps fit all gaps of 860 and 880 um that follow one another, in several places.
        let even = core::array::from_fn::<_, 16, _>(|i| peak(900.0 + 112.0 * i as f32));
        let is_unclear = matches!(assign(&even, &comb), Err(Fault::SlitsUnclear { .. }));
        assert!(is_unclear);
    }
}
