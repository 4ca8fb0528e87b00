//! What a search found, in words.

use std::collections::BTreeMap;

use object::{Object as _, ObjectSymbol as _, SymbolKind};
use slowest_on_chip::mailbox::Question;
use slowest_on_chip::words::{Maker, Turn, WORDS};
use virtual_board::trace::Call;

use super::Slow;
use crate::prelude::*;

pub fn words_of(question: &Question) -> (Option<Vec<u16>>, Vec<u16>) {
    let mut maker = Box::new(Maker::default());
    let mut words = |turn| {
        let mut words = [0; WORDS];
        maker.write(&question.description, turn, &mut words);
        words.to_vec()
    };
    let before = question.follows.then(|| words(Turn::Before));
    (before, words(Turn::Now))
}

/// The functions that executed a call's instructions, with their numbers, the largest first. A function has
/// the instructions of those that are inlined into it, and of the closures in it.
pub fn attribution(program: &Firmware, call: &Call) -> Result<Vec<(String, u64)>> {
    let elf = object::File::parse(program.bytes())?;
    let functions: BTreeMap<u64, &str> = elf
        .symbols()
        .filter(|symbol| symbol.kind() == SymbolKind::Text)
        .filter_map(|symbol| Some((symbol.address() & !1, symbol.name().ok()?)))
        .collect();
    let mut named = BTreeMap::<String, u64>::new();
    for ((from, _), count) in &call.steps {
        let function = functions.range(..=from).next_back();
        let function = function_of(function.map_or("?", |(_, symbol)| symbol));
        *named.entry(function).or_default() += count;
    }
    let mut found: Vec<(String, u64)> = named.into_iter().collect();
    found.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    Ok(found)
}

/// The function that a symbol names, without the crate. The library's functions that take a closure have the
/// closure in their names: they count for the function around it.
fn function_of(symbol: &str) -> String {
    let name = format!("{:#}", rustc_demangle::demangle(symbol));
    let own = match name.split_once("::{closure") {
        Some((around, _)) => around.rsplit_once("slitrange::").map(|(_, own)| own),
        None => name.trim_start_matches('<').strip_prefix("slitrange::"),
    };
    own.unwrap_or(&name).replace(['<', '>'], "")
}

pub fn markdown(rows: u64, found: &[(Slow, Vec<(String, u64)>)]) -> String {
    let mut text = format!(
        "The search counted {} rows.\n\n\
         | estimator | row | instructions | most of them in |\n\
         |---|---|---:|---|\n",
        thousands(rows)
    );
    for (slow, parts) in found {
        let parts = parts.iter().take(4).map(|(name, count)| {
            // The last two of its path.
            let start = name.rmatch_indices("::").nth(1).map_or(0, |(at, _)| at + 2);
            format!("`{}` {}", &name[start..], thousands(*count))
        });
        let parts: Vec<String> = parts.collect();
        let row = match slow.question.follows {
            true => "following",
            false => "first",
        };
        text += &format!(
            "| {} | {row} | {} | {} |\n",
            slow.question.estimator.name(),
            thousands(slow.instructions.into()),
            parts.join(", ")
        );
    }
    text
}

fn thousands(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::function_of;

    #[test]
    fn closures_count_for_the_function_around_them() {
        #[rustfmt::skip] // A case a line or two.
        let cases = [
            ("slitrange::spot::noise", "spot::noise"),
            ("<slitrange::spot::candidates::Peaks>::search_scale", "spot::candidates::Peaks::search_scale"),
            ("slitrange::spot::list_spots::{closure#7}", "spot::list_spots"),
            ("core::iter::fold::<u32, slitrange::spot::search::{closure#1}>", "spot::search"),
            ("core::iter::fold::<slitrange::centre::gauss_newton::Sample>",
                "core::iter::fold::slitrange::centre::gauss_newton::Sample"),
            ("__aeabi_memcpy4", "__aeabi_memcpy4"),
        ];
        for (symbol, function) in cases {
            assert_eq!(function_of(symbol), function);
        }
    }
}
