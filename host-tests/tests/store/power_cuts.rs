//! Power that is cut at each operation of a save.

use crate::flash::Flash;
use crate::samples::{Size, keep, read, sample, save};
use slitrange::store::Kept;

#[test]
fn what_is_saved_is_read() {
    let mut flash = Flash::erased();
    assert_eq!(read(&mut flash), Kept::Nothing);
    for (i, size) in (0..).zip([Size::Least, Size::Middle, Size::Most].repeat(20)) {
        keep(&mut flash, &sample(size, i));
        let (bytes, operations) = (flash.bytes.clone(), flash.operations);
        assert_eq!(save(&mut flash, &sample(size, i)), Ok(()));
        assert!(
            flash.bytes == bytes && flash.operations == operations,
            "the same again writes nothing"
        );
    }
    assert_eq!(flash.overwritten, 0);
    println!(
        "{:?} erasures, {} operations",
        flash.erases, flash.operations
    );
}
