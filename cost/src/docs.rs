//! The block of a Markdown file that `cargo cost` writes: what stands between two marks.

use anyhow::Context as _;

const FROM: &str = "<!-- cargo cost -->\n";
const TO: &str = "<!-- end -->";

/// The text with its block replaced.
///
/// # Errors
/// The marks are not there.
pub fn with_block(text: &str, block: &str) -> anyhow::Result<String> {
    let (before, rest) = text
        .split_once(FROM)
        .with_context(|| format!("no {}", FROM.trim()))?;
    let (_, after) = rest
        .split_once(TO)
        .with_context(|| format!("no {TO} after {}", FROM.trim()))?;
    Ok(format!("{before}{FROM}\n{block}\n{TO}{after}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_block_changes() {
        let text = "a\n<!-- cargo cost -->\nold\n<!-- end -->\nb\n";
        let once = with_block(text, "new\n").expect("marks");
        assert_eq!(once, "a\n<!-- cargo cost -->\n\nnew\n\n<!-- end -->\nb\n");
        assert_eq!(with_block(&once, "new\n").expect("marks"), once);
        assert!(with_block("a", "new").is_err());
        assert!(with_block("<!-- cargo cost -->\n", "new").is_err());
    }
}
