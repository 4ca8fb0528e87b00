//! No two modules of the core use each other, directly or through others. A module is a file of `src` with
//! its folder.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// The modules that a module's files name as `crate::module`. Comments and inline tests do not count.
fn uses(path: &Path, found: &mut BTreeSet<String>) {
    if path.is_dir() {
        for entry in fs::read_dir(path).expect("a folder") {
            uses(&entry.expect("an entry").path(), found);
        }
    } else if let Ok(source) = fs::read_to_string(path) {
        let code: String = source
            .split("#[cfg(test)]")
            .next()
            .unwrap_or_default()
            .lines()
            .map(|line| line.split("//").next().unwrap_or_default())
            .collect();
        for after in code.split("crate::").skip(1) {
            let is_name = |c: char| c.is_alphanumeric() || c == '_';
            assert!(
                after.starts_with(is_name),
                "one module a `use`: {}",
                path.display()
            );
            found.insert(
                after
                    .split(|c| !is_name(c))
                    .next()
                    .unwrap_or_default()
                    .into(),
            );
        }
    }
}

/// Whether a module leads back to one of those on the way to it.
fn circle<'a>(
    graph: &'a BTreeMap<String, BTreeSet<String>>,
    way: &mut Vec<&'a str>,
) -> Option<String> {
    let here = *way.last()?;
    for next in graph.get(here)?.iter().filter(|next| *next != here) {
        if way.contains(&next.as_str()) {
            return Some(format!("{} -> {next}", way.join(" -> ")));
        }
        way.push(next);
        if let Some(found) = circle(graph, way) {
            return Some(found);
        }
        way.pop();
    }
    None
}

#[test]
fn modules_do_not_use_each_other_in_a_circle() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut graph = BTreeMap::<String, BTreeSet<String>>::new();
    for entry in fs::read_dir(&source).expect("the core's source") {
        let path = entry.expect("an entry").path();
        let name = path
            .file_stem()
            .expect("a name")
            .to_string_lossy()
            .into_owned();
        uses(&path, graph.entry(name).or_default());
    }
    graph.remove("lib");
    assert!(graph["measurement"].contains("spot"), "{graph:?}");
    for module in graph.keys() {
        assert_eq!(circle(&graph, &mut vec![module]), None);
    }
}
