//! The block of a Markdown file that a tool of ours writes: what stands between two marks.

use anyhow::Context as _;

const TO: &str = "<!-- end -->";

/// The text with the block of a tool replaced: `<!-- TOOL -->` and `<!-- end -->` are its marks.
///
/// # Errors
/// The marks are not there.
pub fn with_block(text: &str, tool: &str, block: &str) -> anyhow::Result<String> {
    let from = format!("<!-- {tool} -->\n");
    let (before, rest) = text
        .split_once(&from)
        .with_context(|| format!("no {}", from.trim()))?;
    let (_, after) = rest
        .split_once(TO)
        .with_context(|| format!("no {TO} after {}", from.trim()))?;
    Ok(format!("{before}{from}\n{block}\n{TO}{after}"))
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
        assert_eq!(
            with_block(&once, "cargo cost", "new\n").expect("marks"),
            once
        );
        assert!(with_block("a", "cargo cost", "new").is_err());
        assert!(with_block("<!-- cargo cost -->\n", "cargo cost", "new").is_err());
        assert!(with_block(text, "cargo y", "new").is_err());
    }
}
