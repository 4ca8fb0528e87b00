//! A shift to the left loses bits without a word, which no check for overflow sees. So the core shifts
//! nothing to the left but literal numbers, as in `1 << n`, and multiplies what has a value: the check of
//! products is there.

use std::path::Path;

#[test]
fn only_literals_are_shifted_to_the_left() {
    let core = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../core/src");
    let mut found = Vec::new();
    let files = look(&core, &mut found);
    let core = core.display();
    assert!(files > 30, "{files} files in {core}: is that the core?");
    assert!(found.is_empty(), "write `value * (1 << n)`:\n{found:#?}");
}

/// Lists the shifts of values in the files of a folder. Gives how many files there are.
fn look(folder: &Path, found: &mut Vec<String>) -> usize {
    let entries =
        std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut files = 0;
    for entry in entries {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            files += look(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let source = std::fs::read_to_string(&path).expect("a source file");
            let shifts = shifted_values(&source).into_iter();
            found.extend(shifts.map(|line| format!("{}: {line}", path.display())));
            files += 1;
        }
    }
    files
}

/// The lines that shift something else than a literal. Tests come last in a file. Constants are left out: the
/// compiler computes them, and assertions beside them say where they must not lose bits.
fn shifted_values(source: &str) -> Vec<&str> {
    let code = source.split("#[cfg(test)]").next().unwrap_or_default();
    code.lines()
        .map(str::trim)
        .filter(|line| !line.starts_with("//") && !line.starts_with("assert!"))
        .filter(|line| !line.contains("const "))
        .filter(|line| {
            let mut pieces: Vec<&str> = line.split("<<").collect();
            pieces.pop();
            pieces.iter().any(|before| {
                let mut words = before.trim_end().rsplit(|c: char| !c.is_alphanumeric());
                let word = words.next().unwrap_or_default();
                !word.starts_with(|c: char| c.is_ascii_digit())
            })
        })
        .collect()
}

#[test]
fn a_shifted_value_is_found() {
    let source = "const A: u32 = B << 3;\nlet a = 1u32 << n;\nlet b = a << 3;\nlet c = f(x) << 1;\n\
                  // d << 4\n#[cfg(test)]\ne << 5";
    assert_eq!(
        shifted_values(source),
        ["let b = a << 3;", "let c = f(x) << 1;"]
    );
}
