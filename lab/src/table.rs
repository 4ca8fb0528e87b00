//! Tables of text: for a terminal and for a Markdown page.

use std::fmt::Write as _;

/// A table for a terminal: columns as wide as they need to be, the first to the left and the others to the
/// right.
pub fn text<R: AsRef<[String]>>(rows: &[R]) -> String {
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.as_ref().get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
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

/// A table of a Markdown page, aligned likewise. The names of the columns stand between bars.
pub fn of(head: &str, rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let columns = head.split(" | ").count();
    let mut out = format!("| {head} |\n|---|{}\n", "---:|".repeat(columns - 1));
    for row in rows {
        let _ = writeln!(out, "| {} |", row.join(" | "));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up() {
        let row = |cells: [&str; 2]| cells.map(str::to_owned);
        let rows = [row(["a", "σ 1"]), row(["bcd", "10000"])];
        assert_eq!(text(&rows), "a      σ 1\nbcd  10000\n");
        assert_eq!(
            of("a | σ 1", [rows[1].to_vec()]),
            "| a | σ 1 |\n|---|---:|\n| bcd | 10000 |\n"
        );
    }
}
