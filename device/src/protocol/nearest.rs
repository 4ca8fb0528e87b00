//! Finds the name that a person meant who mistyped it.

/// The longest word that is compared, in bytes. No name is longer.
const LONGEST: usize = 24;

/// The most letters that may be wrong: missing, too many, or others.
const MOST_WRONG: usize = 2;

/// The name that differs least from a word, if at most two letters are wrong, and fewer than half. Of two
/// names that differ alike, the first.
pub fn nearest(word: &str, names: impl Iterator<Item = &'static str>) -> Option<&'static str> {
    let most = MOST_WRONG.min(word.len() / 2);
    let compared = names.filter_map(|name| Some((distance(word, name)?, name)));
    let (wrong, name) = compared.min_by_key(|&(wrong, _)| wrong)?;
    (usize::from(wrong) <= most).then_some(name)
}

/// Levenshtein's distance: how many letters must be inserted, dropped or replaced (Soviet Physics Doklady 10,
/// 707 (1966)). `None` if one of the words is longer than [`LONGEST`].
fn distance(from: &str, to: &str) -> Option<u8> {
    let [from, to] = [from.as_bytes(), to.as_bytes()];
    if from.len() > LONGEST || to.len() > LONGEST {
        return None;
    }
    // From no letter of `from` to each beginning of `to`.
    let mut costs = [0; LONGEST + 1];
    for (place, cost) in costs.iter_mut().zip(0u8..) {
        *place = cost;
    }
    let mut last = u8::try_from(to.len()).ok()?;
    // No cost exceeds the longer word's length.
    for (letter, row) in from.iter().zip(1u8..) {
        let (first, rest) = costs.split_first_mut()?;
        let mut diagonal = core::mem::replace(first, row);
        let mut left = row;
        for (above, other) in rest.iter_mut().zip(to) {
            let replaced = diagonal.saturating_add(u8::from(letter != other));
            diagonal = *above;
            let dropped = diagonal.min(left).saturating_add(1);
            left = replaced.min(dropped);
            *above = left;
        }
        last = left;
    }
    Some(last)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_counts_wrong_letters() {
        for (from, to, wrong) in [
            ("stream", "stream", 0),
            ("strem", "stream", 1),
            ("streaam", "stream", 1),
            ("straem", "stream", 2),
            ("kitten", "sitting", 3),
            ("", "row", 3),
            ("row", "", 3),
            ("a", "b", 1),
        ] {
            assert_eq!(distance(from, to), Some(wrong), "{from} {to}");
            assert_eq!(distance(to, from), Some(wrong), "{to} {from}");
        }
        assert_eq!(distance(&"x".repeat(LONGEST + 1), "row"), None);
    }

    #[test]
    fn a_word_that_is_far_from_all_names_has_no_nearest() {
        let names = || ["rows", "row", "stream", "save"].into_iter();
        for (word, expected) in [
            ("rwos", Some("rows")),
            ("sav", Some("save")),
            ("streem", Some("stream")),
            ("raw", Some("row")),
            ("xx", None),
            ("frobnicate", None),
            ("q", None),
            ("", None),
        ] {
            assert_eq!(nearest(word, names()), expected, "{word}");
        }
    }
}
