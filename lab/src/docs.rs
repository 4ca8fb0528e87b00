//! The blocks of Markdown files that our tools write: what stands between two marks.

use crate::prelude::*;

const TO: &str = "<!-- end -->";

/// The longest line of a page in characters. Only rows of tables may be longer.
const COLUMNS: usize = 110;

/// A file of the workspace, named from the workspace's root.
pub fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name)
}

/// The text with the block of a tool replaced: `<!-- TOOL -->` and `<!-- end -->` are its marks. Long lines
/// of the block are wrapped.
pub fn with_block(text: &str, tool: &str, block: &str) -> anyhow::Result<String> {
    let from = format!("<!-- {tool} -->\n");
    let (before, rest) = (text.split_once(&from)).with_context(|| format!("no {}", from.trim()))?;
    let after = rest.split_once(TO).map(|(_, after)| after);
    let after = after.with_context(|| format!("no {TO} after {}", from.trim()))?;
    Ok(format!("{before}{from}\n{}\n{TO}{after}", wrapped(block)))
}

/// Rewrites the block of a tool in a page. The page is named from the workspace's root.
pub fn write_block(page: &str, tool: &str, block: &str) -> anyhow::Result<()> {
    let text = std::fs::read_to_string(path(page)).with_context(|| page.to_owned())?;
    std::fs::write(path(page), with_block(&text, tool, block)?).with_context(|| page.to_owned())
}

/// Prints blocks, each with its mark, and rewrites them in a page. Without `--write` it says that it does
/// not.
pub fn print_or_write(
    command: &str,
    is_write: bool,
    page: &str,
    blocks: &[(&str, String)],
) -> anyhow::Result<()> {
    for (mark, block) in blocks {
        println!("{block}");
        if is_write {
            write_block(page, mark, block)?;
        }
    }
    if !is_write {
        print_hint(command, page);
    }
    Ok(())
}

/// Prints the last line of a run without `--write`: which files `--write` updates.
pub fn print_hint(command: &str, files: &str) {
    println!("\nNo file of the repository has changed. `{command} --write` updates {files}.");
}

/// Breaks the long lines of a Markdown text between words. Tables, headings and code stay as they are.
fn wrapped(text: &str) -> String {
    let mut out = String::new();
    for line in text.split_inclusive('\n') {
        if line.trim_end().chars().count() <= COLUMNS || line.starts_with(['|', '#', ' ']) {
            out += line;
            continue;
        }
        let indent = if line.starts_with("- ") { "  " } else { "" };
        let mut column = 0;
        for word in line.split_whitespace() {
            let length = word.chars().count();
            if column > 0 && column + 1 + length > COLUMNS {
                out += "\n";
                out += indent;
                column = indent.len();
            } else if column > 0 {
                out.push(' ');
                column += 1;
            }
            out += word;
            column += length;
        }
        if line.ends_with('\n') {
            out.push('\n');
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_block_changes() {
        let text = "a\n<!-- cargo cost -->\nold\n<!-- end -->\nb\n<!-- cargo x -->\n<!-- end -->\n";
        let once = with_block(text, "cargo cost", "new\n").expect("marks");
        assert_eq!(
            once,
            "a\n<!-- cargo cost -->\n\nnew\n\n<!-- end -->\nb\n<!-- cargo x -->\n<!-- end -->\n"
        );
        let twice = with_block(&once, "cargo cost", "new\n").expect("marks");
        assert_eq!(twice, once);
        assert!(with_block("a", "cargo cost", "new").is_err());
        assert!(with_block("<!-- cargo cost -->\n", "cargo cost", "new").is_err());
        assert!(with_block(text, "cargo y", "new").is_err());
    }

    #[test]
    fn paragraphs_and_lists_are_wrapped_and_tables_are_not() {
        let long = "word ".repeat(30).trim_end().to_owned();
        let first = "word ".repeat(22).trim_end().to_owned();
        let rest = "word ".repeat(8).trim_end().to_owned();
        assert_eq!(first.len(), 109);
        let paragraph = wrapped(&format!("{long}\nb"));
        assert_eq!(paragraph, format!("{first}\n{rest}\nb"));
        let item = wrapped(&format!("- {long}\n"));
        assert!(item.starts_with("- word") && item.contains("\n  word"));
        assert!(item.ends_with("word\n"));
        assert!(item.lines().all(|line| line.chars().count() <= COLUMNS));
        for line in [format!("| {long} |\n"), format!("# {long}\n"), first] {
            assert_eq!(wrapped(&line), line);
        }
    }

    #[test]
    fn the_readme_and_the_pages_have_short_lines() {
        let folder = |name| std::fs::read_dir(path(name)).expect(name);
        let docs = folder("docs").chain(folder("docs/hardware"));
        let pages = docs.map(|entry| entry.expect("an entry").path());
        let pages = pages.filter(|page| page.extension().is_some_and(|it| it == "md"));
        for page in pages.chain([path("README.md")]) {
            let text = std::fs::read_to_string(&page).expect("a page");
            // Rows of tables and what programs print cannot be wrapped, except in the README.
            let must_fit =
                |line: &str| page.ends_with("README.md") || !line.starts_with(['|', ' ']);
            for (number, line) in text.lines().enumerate() {
                assert!(
                    !must_fit(line) || line.chars().count() <= COLUMNS,
                    "{}:{}: {line}",
                    page.display(),
                    number + 1
                );
            }
        }
    }
}
