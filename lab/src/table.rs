//! Tables of text: for a terminal and for a Markdown page. The first row is the head.

use std::fmt::Write as _;

/// Cells of text from words.
pub fn cells(words: &[&str]) -> Vec<String> {
    words.iter().map(|&word| word.to_owned()).collect()
}

/// A table for a terminal: columns as wide as they need to be, the first to the left and the others to the
/// right.
pub fn text<R: AsRef<[String]>>(rows: &[R]) -> String {
    let width = |column: usize| {
        rows.iter()
            .filter_map(|row| row.as_ref().get(column))
            .map(|cell| cell.chars().count())
            .max()
            .unwrap_or(0)
    };
    let mut out = String::new();
    for row in rows {
        for (column, cell) in row.as_ref().iter().enumerate() {
            let width = width(column);
            let _ = match column {
                0 => write!(out, "{cell:<width$}"),
                _ => write!(out, "  {cell:>width$}"),
            };
        }
        out.push('\n');
    }
    out
}

/// A table of a Markdown page, aligned likewise.
pub fn markdown<R: AsRef<[String]>>(rows: &[R]) -> String {
    let mut out = String::new();
    for (i, row) in rows.iter().enumerate() {
        let row = row.as_ref();
        let _ = writeln!(out, "| {} |", row.join(" | "));
        if i == 0 {
            let _ = writeln!(out, "|---|{}", "---:|".repeat(row.len() - 1));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up() {
        let rows = [cells(&["a", "σ 1"]), cells(&["bcd", "10000"])];
        assert_eq!(text(&rows), "a      σ 1\nbcd  10000\n");
        assert_eq!(
            markdown(&rows),
            "| a | σ 1 |\n|---|---:|\n| bcd | 10000 |\n"
        );
    }
}
