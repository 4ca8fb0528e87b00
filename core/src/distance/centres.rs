//! The centres of knots, and between which of them a centre lies: in as many steps whatever they are, without a branch.

use super::knots::Knot;
use crate::units::Pixels;

/// The centres of up to `MOST` knots in their order, and beyond those the largest that there is. `MOST` is a power of two and one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Centres<const MOST: usize>([Pixels; MOST]);

impl<const MOST: usize> Centres<MOST> {
    /// Those of knots. `None` where there are too many.
    pub fn of(knots: &[Knot]) -> Option<Self> {
        const { assert!((MOST - 1).is_power_of_two()) };
        let mut centres = [Pixels::MAX; MOST];
        for (at, knot) in centres.get_mut(..knots.len())?.iter_mut().zip(knots) {
            *at = knot.centre;
        }
        Some(Self(centres))
    }

    /// That of a knot.
    pub fn get(&self, index: usize) -> Option<Pixels> {
        self.0.get(index).copied()
    }

    /// The last knot that lies before a centre, and the first where none does: below `MOST` - 1.
    ///
    /// Bit by bit, from the highest: with `index` lies every knot before it before the centre too.
    #[inline(always)]
    pub fn before(&self, centre: Pixels) -> usize {
        let mut index = 0;
        let mut bit = MOST / 2;
        while bit > 0 {
            // The compiler sees that it is in the array, and looks without asking.
            let next = index | bit;
            if self.0.get(next).is_some_and(|knot| *knot < centre) {
                index = next;
            }
            bit /= 2;
        }
        index
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Micrometres;

    #[test]
    fn the_knot_before_is_found() {
        let knots: [Knot; 9] = core::array::from_fn(|i| Knot {
            centre: Pixels::from_bits(10 * i as i32),
            value: Micrometres::default(),
        });
        for count in 2..=knots.len() {
            let knots = &knots[..count];
            let centres = Centres::<9>::of(knots).expect("room for nine");
            for bits in -5..=10 * (count as i32 - 1) {
                let centre = Pixels::from_bits(bits);
                let before = knots.iter().rposition(|knot| knot.centre < centre);
                assert_eq!(
                    centres.before(centre),
                    before.unwrap_or(0),
                    "{bits} of {count}"
                );
            }
        }
        assert_eq!(Centres::<5>::of(&knots), None);
        let centres = Centres::<9>::of(&knots).expect("room for nine");
        assert_eq!(centres.get(8), Some(knots[8].centre));
        assert_eq!(centres.get(9), None);
        assert_eq!(centres.before(Pixels::MAX), 7);
    }
}
