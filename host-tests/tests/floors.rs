//! Modules stand in order: each uses only those that its crate's lib.rs declares before it.

use std::fs;
use std::path::{Path, PathBuf};

/// All files of a folder and its folders.
fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            files(&path, found);
        } else {
            found.push(path);
        }
    }
}

/// Code without comments and without inline tests.
fn code(path: &Path) -> String {
    let source = fs::read_to_string(path).expect("a source file");
    let code = source.split("#[cfg(test)]").next().unwrap_or_default();
    let lines = code.lines().map(|line| line.split("//").next());
    lines
        .map(|line| line.unwrap_or_default().to_owned() + "\n")
        .collect()
}

/// The names that follow a word in code.
fn names_after<'a>(code: &'a str, word: &'a str) -> impl Iterator<Item = &'a str> {
    code.split(word).skip(1).map(move |after| {
        let end = after.find(|c: char| !c.is_alphanumeric() && c != '_');
        let name = &after[..end.unwrap_or(after.len())];
        assert!(!name.is_empty(), "one module a `use`: {word}{after:.40}");
        name
    })
}

#[test]
fn a_module_uses_only_modules_before_it() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    for source in ["core/src", "device/src"].map(|crate_| root.join(crate_)) {
        let library = code(&source.join("lib.rs"));
        let floors: Vec<&str> = names_after(&library, "pub mod ").collect();
        let floor = |name: &str| floors.iter().position(|it| *it == name);
        let mut arrows = 0;
        let mut found = Vec::new();
        files(&source, &mut found);
        for path in found {
            let inside = path.strip_prefix(&source).expect("a file of the crate");
            let module = inside.iter().next().expect("a name").to_string_lossy();
            let module = module.trim_end_matches(".rs");
            let Some(here) = floor(module) else {
                assert_eq!(module, "lib");
                continue;
            };
            for used in names_after(&code(&path), "crate::") {
                let there = floor(used).expect("a module of lib.rs");
                assert!(there <= here, "{} uses {used}", inside.display());
                arrows += usize::from(there < here);
            }
        }
        println!(
            "{}: {} modules, {arrows} uses of one before",
            source.display(),
            floors.len()
        );
        assert!(arrows > 10);
    }
}
