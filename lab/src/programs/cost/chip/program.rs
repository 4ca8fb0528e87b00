//! The program's machine code: its functions, and its instructions as `llvm-objdump` shows them.

use std::collections::BTreeMap;
use std::process::Command;

use cost_on_chip::methods::Method;
use object::{Object as _, ObjectSymbol as _, SymbolKind};

use super::steps;
use crate::prelude::*;

#[derive(Clone, Debug)]
struct Function {
    bytes: u64,
    /// As Rust names it.
    name: String,
}

#[derive(Debug)]
pub struct Program {
    functions: BTreeMap<u64, Function>,
    addresses: BTreeMap<String, u64>,
    /// Where instructions jump to or call, by their addresses.
    targets: BTreeMap<u64, u64>,
}

impl Program {
    pub fn of(firmware: &Firmware) -> Result<Self> {
        let elf = object::File::parse(firmware.bytes())?;
        let (mut functions, mut addresses) = (BTreeMap::new(), BTreeMap::new());
        for symbol in elf.symbols() {
            if symbol.kind() != SymbolKind::Text || symbol.size() == 0 {
                continue;
            }
            let symbol_name = symbol.name()?;
            // Bit 0 says that it is Thumb code.
            let address = symbol.address() & !1;
            addresses.insert(symbol_name.to_owned(), address);
            let function = Function {
                bytes: symbol.size(),
                name: format!("{:#}", rustc_demangle::demangle(symbol_name)),
            };
            functions.insert(address, function);
        }
        Ok(Self {
            functions,
            addresses,
            targets: disassembly(firmware)?.lines().filter_map(target).collect(),
        })
    }

    /// The address of a function that keeps its name.
    pub fn address(&self, symbol: &str) -> Option<u64> {
        self.addresses.get(symbol).copied()
    }

    pub fn named(&self, name: &str) -> Option<u64> {
        self.functions
            .iter()
            .find(|(_, function)| function.name == name)
            .map(|(&address, _)| address)
    }

    pub fn traced(&self) -> impl Iterator<Item = u64> {
        Method::ALL
            .into_iter()
            .filter_map(|method| self.address(&super::wrapper(method.name())))
            .chain(self.named(super::DISTANCE_AT))
            .chain(self.address(steps::ROW))
            .chain(self.address(steps::READING))
    }

    /// The bytes of all functions that can be reached from `symbol` by a call or a jump, its own and their
    /// constants among the code included. What is called through a pointer is not seen; constants elsewhere
    /// (tables of jumps and of weights) are not counted.
    pub fn reachable_bytes(&self, symbol: &str) -> Result<u64> {
        let start = self
            .address(symbol)
            .with_context(|| format!("the chip's program has no function {symbol}"))?;
        let (mut reached, mut to_look_at) = (BTreeSet::new(), vec![start]);
        while let Some(address) = to_look_at.pop() {
            if reached.insert(address) {
                to_look_at.extend(self.called_from(address));
            }
        }
        Ok(reached
            .iter()
            .map(|address| self.functions[address].bytes)
            .sum())
    }

    fn called_from(&self, function: u64) -> Vec<u64> {
        let end = function + self.functions[&function].bytes;
        self.targets
            .range(function..end)
            .filter_map(|(_, &target)| self.function_around(target))
            .collect()
    }

    fn function_around(&self, address: u64) -> Option<u64> {
        let (&start, function) = self.functions.range(..=address).next_back()?;
        (address < start + function.bytes).then_some(start)
    }
}

/// The program as `llvm-objdump` shows it.
pub fn disassembly(firmware: &Firmware) -> Result<String> {
    let output = Command::new(objdump()?)
        .args(["--disassemble", "--mcpu=cortex-m4"])
        .arg(firmware.path())
        .output()
        .context("llvm-objdump did not start")?;
    ensure!(
        output.status.success(),
        "llvm-objdump failed: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    Ok(String::from_utf8(output.stdout)?)
}

/// `llvm-objdump` of the toolchain's component llvm-tools, which `rust-toolchain.toml` asks for.
fn objdump() -> Result<PathBuf> {
    let ask = |arguments: &[&str]| {
        let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
        let output = Command::new(rustc)
            .args(arguments)
            .output()
            .context("rustc did not start")?;
        Ok::<String, anyhow::Error>(String::from_utf8(output.stdout)?)
    };
    let about = ask(&["-vV"])?;
    let host = about
        .lines()
        .find_map(|line| line.strip_prefix("host: "))
        .context("rustc does not name its host")?;
    let tool = PathBuf::from(ask(&["--print", "sysroot"])?.trim())
        .join("lib/rustlib")
        .join(host)
        .join("bin/llvm-objdump")
        .with_extension(std::env::consts::EXE_EXTENSION);
    ensure!(
        tool.exists(),
        "{} is missing: rustup component add llvm-tools",
        tool.display()
    );
    Ok(tool)
}

/// The address of an instruction that jumps or calls, and where to, from a line of address, halfwords, name,
/// operands and remarks, the latter three after tabs: ` 80001b0: f00f fc4e bl 0x800fa50 <__pre_init> @ imm =
/// #0xf89c`. The names of branches begin with B or CB. Other instructions whose names do have no address.
fn target(line: &str) -> Option<(u64, u64)> {
    let (address, rest) = line.split_once(':')?;
    let mut columns = rest.split('\t').skip(1);
    if !columns.next()?.trim().starts_with(['b', 'c']) {
        return None;
    }
    let operands = columns.next()?.split('@').next()?;
    let operand = operands.split(", ").last()?.split_whitespace().next()?;
    let hex = |digits| u64::from_str_radix(digits, 16).ok();
    Some((hex(address.trim())?, hex(operand.strip_prefix("0x")?)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All names of the FPU's instructions begin with V. Only rows that are not clean take the repair, and
    /// ask what their shape adds to u.
    #[test]
    #[ignore = "builds the firmware; run by .ci/run"]
    fn the_check_of_a_clean_row_uses_no_float() {
        let firmware = Firmware::build().expect("the firmware");
        let text = disassembly(&firmware).expect("the program");
        let mut found = vec![];
        for function in text.split("\n\n") {
            let head = function.lines().find(|line| line.ends_with(">:"));
            let Some(head) = head.and_then(|head| head.split('<').nth(1)) else {
                continue;
            };
            let of_others = ["6repair", "12is_expressed"];
            let is_checks = head.contains("9slitrange5check")
                && !of_others.iter().any(|name| head.contains(name))
                || ["8cortex_m4gram", "7numeric12exp_of_minus"]
                    .iter()
                    .any(|name| head.contains(name));
            if !is_checks {
                continue;
            }
            let mnemonics = (function.lines()).filter_map(|line| line.split('\t').nth(1));
            let mut floats = mnemonics.filter(|name| name.trim().starts_with('v'));
            assert_eq!(floats.next(), None, "{head}");
            found.push(head);
        }
        println!("{found:#?}");
        for name in [
            "7compare",
            "11by_symmetry",
            "8Symmetry",
            "7list_of",
            "8list_any",
            "7Factors",
            "4gram",
        ] {
            assert!(found.iter().any(|found| found.contains(name)), "{name}");
        }
    }

    #[test]
    fn branches_have_targets() {
        for (line, expected) in [
            (
                " 80001b0: f00f fc4e    \tbl\t0x800fa50 <__pre_init>  @ imm = #0xf89c",
                Some((0x800_01b0, 0x800_fa50)),
            ),
            (
                " 80001b0: b1a2         \tcbz\tr2, 0x80001dc <x+0x40> @ imm = #0x28",
                Some((0x800_01b0, 0x800_01dc)),
            ),
            (
                " 80001b2: d1f2         \tbne.w\t0x800019a <x> @ imm = #-0x1c",
                Some((0x800_01b2, 0x800_019a)),
            ),
            (" 8000220: eeb1 0ac0    \tvsqrt.f32\ts0, s0", None),
            (" 8000220: f36f 0207    \tbfc\tr2, #0x0, #0x8", None),
            (" 8000220: f020 0001    \tbic\tr0, r0, #0x1", None),
            (" 8000220: 4770         \tbx\tlr", None),
            (" 8000220: beab         \tbkpt\t#0xab", None),
            (" 8000220: 2801         \tcmp\tr0, #0x1", None),
            (" 8000400: 00 01 02 03  \t.word\t0x03020100", None),
            ("08000220 <main>:", None),
        ] {
            assert_eq!(target(line), expected, "{line}");
        }
    }
}
