//! Crates and modules stand in order: each uses only those before it.

use std::fs;
use std::path::{Path, PathBuf};

/// The crates, each of which depends only on those before it. Tests and build scripts count.
const CRATES: &[&str] = &[
    "core/dual-mac",
    "core/phase-tables",
    "core",
    "device",
    "statistics",
    "simulator",
    "judges",
    "calibration",
    "figures",
    "on-chip/answers",
    "on-chip/cost",
    "on-chip/slowest",
    "virtual-board",
    "tool",
    "lab",
    // No crate depends on these.
    ".",
    "host-tests",
    "on-chip/panic-free",
    "on-chip/silicon-check",
];

/// The files of a crate that declare modules: of its library, and of its programs.
const ROOTS: [&str; 3] = ["src/lib.rs", "src/main.rs", "src/bin/demo/main.rs"];

/// Modules of tests and programs, which may use all others.
const ABOVE: [&str; 6] = ["bin", "chip", "lib", "main", "pages", "tests"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

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
    let source = read(path);
    let code = source.split("#[cfg(test)]").next().unwrap_or_default();
    let lines = code.lines().filter_map(|line| line.split("//").next());
    lines.flat_map(|line| [line, "\n"]).collect()
}

/// The names that follow a word in code: one, or a list in braces.
fn names_after<'a>(code: &'a str, word: &'a str) -> impl Iterator<Item = &'a str> {
    let is_end = |c: char| !c.is_alphanumeric() && c != '_';
    code.split(word).skip(1).flat_map(move |after| {
        let list = match after.strip_prefix('{') {
            Some(list) => list.split('}').next().unwrap_or_default(),
            None => after.split(is_end).next().unwrap_or_default(),
        };
        assert!(!list.is_empty(), "a name after {word}: {after:.40}");
        list.split(is_end).filter(|name| !name.is_empty())
    })
}

#[test]
fn a_module_uses_only_modules_before_it() {
    let mut all_arrows = 0;
    let names = (CRATES.iter()).flat_map(|name| ROOTS.map(|file| format!("{name}/{file}")));
    for name in names.filter(|name| root().join(name).exists()) {
        let path = root().join(&name);
        let declarations = code(&path);
        let floors: Vec<&str> = names_after(&declarations, "mod ").collect();
        if floors.len() < 2 {
            continue;
        }
        let floor = |name: &str| floors.iter().position(|it| *it == name);
        let source = path.parent().expect("a folder");
        let mut arrows = 0;
        let mut found = Vec::new();
        files(source, &mut found);
        found.retain(|path| path.extension().is_some_and(|it| it == "rs"));
        found.retain(|path| !path.ends_with("tests.rs"));
        for path in found {
            let inside = path.strip_prefix(source).expect("a file of the crate");
            let module = inside.iter().next().expect("a name").to_string_lossy();
            let module = module.trim_end_matches(".rs");
            let Some(here) = floor(module) else {
                assert!(ABOVE.contains(&module), "{name}: {module}");
                continue;
            };
            // `super::` leads to the root too, as often as a module is deep.
            let depth = inside.iter().count() - usize::from(inside.ends_with("mod.rs"));
            let (code, supers) = (code(&path), "super::".repeat(depth));
            for used in names_after(&code, "crate::").chain(names_after(&code, &supers)) {
                let there = floor(used);
                let there = there.unwrap_or_else(|| panic!("{name}: {used} is no module"));
                assert!(there <= here, "{name}: {} uses {used}", inside.display());
                arrows += usize::from(there < here);
            }
        }
        let modules = floors.len();
        println!("{name}: {modules} modules, {arrows} uses of one before");
        assert!(arrows > 0, "{name}");
        all_arrows += arrows;
    }
    assert!(all_arrows > 500, "{all_arrows}");
}

/// The name of a manifest's package.
fn package(manifest: &str) -> &str {
    let name = (manifest.lines()).find_map(|line| line.strip_prefix("name = "));
    name.expect("a package").trim_matches('"')
}

/// The names in the sections of a manifest that list what the package depends on.
fn dependencies(manifest: &str) -> impl Iterator<Item = &str> {
    let mut is_listed = false;
    manifest.lines().filter_map(move |line| {
        if line.starts_with('[') {
            is_listed = line.ends_with("dependencies]") && !line.starts_with("[workspace");
        }
        is_listed.then(|| line.split([' ', '.', '=']).next())?
    })
}

#[test]
fn a_crate_depends_only_on_crates_before_it() {
    let manifest = |name: &&str| read(&root().join(name).join("Cargo.toml"));
    let manifests: Vec<String> = CRATES.iter().map(manifest).collect();
    let floor = |name: &str| manifests.iter().position(|it| package(it) == name);
    let mut arrows = 0;
    for (here, manifest) in manifests.iter().enumerate() {
        for there in dependencies(manifest).filter_map(floor) {
            assert!(there < here, "{} uses {}", CRATES[here], CRATES[there]);
            arrows += 1;
        }
    }
    println!("{} crates, {arrows} arrows", CRATES.len());
    assert!(arrows > 40);

    let workspace = read(&root().join("Cargo.toml"));
    let members = workspace.split("members = [").nth(1).expect("members");
    let members = members.split(']').next().unwrap_or_default();
    let members: Vec<&str> = members.split('"').skip(1).step_by(2).collect();
    let missing = members.iter().find(|name| !CRATES.contains(name));
    assert_eq!(missing, None, "no place in the order of crates");
    assert_eq!(members.len(), CRATES.len());
}

/// Only the board and the drivers of the sensor heads know the chip.
#[test]
fn the_rest_of_the_firmware_names_no_chip() {
    let source = root().join("src");
    let of_the_chip = ["board", "heads"].map(|folder| source.join(folder));
    let is_of_the_chip = |path: &Path| of_the_chip.iter().any(|folder| path.starts_with(folder));
    let mut found = Vec::new();
    files(&source, &mut found);
    let (chip, rest): (Vec<_>, Vec<_>) = found.iter().partition(|path| is_of_the_chip(path));
    assert!(chip.len() > 10 && rest.len() > 5, "{found:?}");
    for path in rest {
        let code = code(path);
        let mut words = code.split(|c: char| !c.is_alphanumeric() && c != '_');
        let name = words.find(|word| ["embassy_stm32", "cortex_m", "pac"].contains(word));
        assert_eq!(name, None, "{}", path.display());
    }
}
