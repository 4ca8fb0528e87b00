//! Where a program can panic.
//!
//! The handler passes on the `core::panic::Location` that it is given, so the program holds those that can
//! get there and no other:
//! in memory, on 32 bits, the address and length of the file's name, the line and the column.

use std::collections::BTreeSet;

use object::read::elf::ElfFile32;
use object::{Endianness, Object as _, ObjectSection as _};

/// As `file:line:column`, sorted.
pub fn places(program: &[u8]) -> Vec<String> {
    let program: ElfFile32<'_, Endianness> =
        ElfFile32::parse(program).expect("an ELF file of 32 bits");
    let text = |address: u32, length: u32| {
        program.sections().find_map(|section| {
            let bytes = section.data_range(address.into(), length.into()).ok()??;
            std::str::from_utf8(bytes).ok()
        })
    };
    let mut places = BTreeSet::new();
    for section in program.sections().filter(|section| section.address() != 0) {
        let bytes = section.data().unwrap_or_default();
        let words = bytes.as_chunks().0.iter();
        let words: Vec<u32> = words.map(|&word| u32::from_le_bytes(word)).collect();
        for &[address, length, line, column] in words.array_windows() {
            if let Some(file) = text(address, length).filter(|file| file.ends_with(".rs")) {
                places.insert((file, line, column));
            }
        }
    }
    let names = places.iter();
    let names = names.map(|(file, line, column)| format!("{file}:{line}:{column}"));
    names.collect()
}
