//! What a plain row takes on a chip without an FPU: ARMv6-M, as of a Cortex-M0+.

use crate::prelude::*;
use crate::slowest::{self, Chip};
use crate::table;

/// Cycles an instruction of a Cortex-M0+, estimated: a load, a store and a jump take two and the others one,
/// with a multiplier of one cycle and a flash without wait states (Cortex-M0+ Technical Reference Manual,
/// r0p1, table 3-1).
const CYCLES: f64 = 1.4;
const CLOCKS_MHZ: [f64; 2] = [48.0, 133.0];

/// The table of docs/accuracy.md.
pub fn markdown() -> Result<String> {
    let mut with = Chip::power_on()?;
    let mut without = Chip::power_on_for(slowest::WITHOUT_FPU)?;
    let rows = |follows| Estimator::ALL.map(|estimator| slowest::plain_row(estimator, follows));
    let [following, first] = [true, false].map(rows);
    let (with, first) = (with.count(&following)?, without.count(&first)?);
    let counts = without.count(&following)?;
    let mut rows = vec![];
    for (i, question) in following.iter().enumerate() {
        let call = without.trace(question)?;
        let floats = floats(&slowest::attribution(without.program(), &call)?) as f64;
        let mut row = vec![question.estimator.name().to_owned()];
        row.extend([with[i], counts[i], first[i]].map(|count| count.to_string()));
        row.push(format!("{:.0} %", 100.0 * floats / f64::from(counts[i])));
        let a_second = |mhz: f64| mhz * 1e6 / (CYCLES * f64::from(counts[i]));
        row.extend(CLOCKS_MHZ.map(|mhz| format!("{:.0}", a_second(mhz))));
        rows.push(row);
    }
    without.finish()?;
    let clocks = CLOCKS_MHZ.map(|mhz| format!("rows/s, {mhz} MHz"));
    let clocks = clocks.join(" | ");
    let head = format!("estimator | following, FPU | following | first | in floats | {clocks}");
    Ok(table::of(&head, rows))
}

/// The instructions of the compiler's functions for f32 (Run-time ABI for the Arm Architecture, 5.1.2).
pub fn floats(functions: &[(String, u64)]) -> u64 {
    let is_float = |name: &str| {
        let of_abi = name.strip_prefix("__aeabi_");
        let of_abi = of_abi.is_some_and(|it| it.starts_with('f') || it.contains("2f"));
        of_abi || name.contains("::float::")
    };
    let of_floats = functions.iter().filter(|(name, _)| is_float(name));
    of_floats.map(|(_, instructions)| instructions).sum()
}
