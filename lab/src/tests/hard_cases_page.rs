//! docs/hard-cases.md against the catalogue.

use std::path::Path;

use host_tests::hard_cases::report::{self, Catalogue};

use crate::docs;

#[test]
fn the_page_agrees_with_the_catalogue() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/hard-cases.md");
    let text = std::fs::read_to_string(page).expect("docs/hard-cases.md");
    let tables = Catalogue::run().markdown();
    let due = docs::with_block(&text, report::CATALOGUE, &tables).expect("marks");
    let differing = text.lines().zip(due.lines()).find(|(is, due)| is != due);
    assert!(
        text == due,
        "docs/hard-cases.md is not what `cargo hard-cases --write` writes. (is, due): {differing:#?}"
    );
}
