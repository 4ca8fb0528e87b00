//! The program's machine code: its functions, and its instructions as `llvm-objdump` shows them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use cost_on_chip::methods::Method;
use object::{Object as _, ObjectSymbol as _, SymbolKind};
use virtual_board::Firmware;

use super::steps;

/// An instruction.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Instruction {
    /// Its name, with a condition or width if it has one: `ldr.w`.
    mnemonic: String,
    /// Its operands, as text.
    operands: String,
}

/// A function.
#[derive(Clone, Debug)]
struct Function {
    bytes: u64,
    /// As Rust names it.
    name: String,
}

/// The machine code of an ELF file.
#[derive(Debug)]
pub struct Program {
    functions: BTreeMap<u64, Function>,
    addresses: BTreeMap<String, u64>,
    instructions: BTreeMap<u64, Instruction>,
}

impl Program {
    /// Reads and disassembles an ELF file.
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
            instructions: disassemble(firmware)?,
        })
    }

    /// The address of a function that keeps its name.
    pub fn address(&self, symbol: &str) -> Option<u64> {
        self.addresses.get(symbol).copied()
    }

    /// The address of a function by the name that Rust gives it.
    pub fn named(&self, name: &str) -> Option<u64> {
        self.functions
            .iter()
            .find(|(_, function)| function.name == name)
            .map(|(&address, _)| address)
    }

    /// The functions whose calls are traced.
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

    /// The functions that the function at an address calls or jumps into.
    fn called_from(&self, function: u64) -> Vec<u64> {
        let end = function + self.functions[&function].bytes;
        self.instructions
            .range(function..end)
            .filter_map(|(_, instruction)| instruction.target())
            .filter_map(|target| self.function_around(target))
            .collect()
    }

    fn function_around(&self, address: u64) -> Option<u64> {
        let (&start, function) = self.functions.range(..=address).next_back()?;
        (address < start + function.bytes).then_some(start)
    }
}

impl Instruction {
    /// Where a direct branch or call goes to.
    fn target(&self) -> Option<u64> {
        if !(self.is_branch() || self.mnemonic.starts_with("cb")) {
            return None;
        }
        let operand = self.operands.split(", ").last()?;
        let digits = operand.split_whitespace().next()?.strip_prefix("0x")?;
        u64::from_str_radix(digits, 16).ok()
    }

    /// B, BL, BX, BLX and B with a condition.
    fn is_branch(&self) -> bool {
        const CONDITIONS: [&str; 14] = [
            "eq", "ne", "hs", "lo", "mi", "pl", "vs", "vc", "hi", "ls", "ge", "lt", "gt", "le",
        ];
        let name = self.mnemonic.split('.').next().unwrap_or_default();
        let Some(rest) = name.strip_prefix('b') else {
            return false;
        };
        // BL and BLE, BLS, BLT, BLO: what follows B first.
        CONDITIONS.contains(&rest)
            || ["", "l", "x", "lx"].into_iter().any(|form| {
                rest.strip_prefix(form)
                    .is_some_and(|rest| rest.is_empty() || CONDITIONS.contains(&rest))
            })
    }
}

/// All instructions of an ELF file.
fn disassemble(firmware: &Firmware) -> Result<BTreeMap<u64, Instruction>> {
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
    let text = String::from_utf8(output.stdout)?;
    Ok(text.lines().filter_map(parse).collect())
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

/// A line of address, halfwords, name, operands and remarks, the latter three after tabs: ` 80001b0: f00f
/// fc4e bl 0x800fa50 <__pre_init> @ imm = #0xf89c`. Data among the code have a name that begins with a dot,
/// and are left out.
fn parse(line: &str) -> Option<(u64, Instruction)> {
    let (address, rest) = line.split_once(':')?;
    let address = u64::from_str_radix(address.trim(), 16).ok()?;
    let mut columns = rest.split('\t');
    let halfwords = columns.next()?.trim();
    let mnemonic = columns.next()?.trim();
    if halfwords.is_empty() || mnemonic.is_empty() || mnemonic.starts_with(['.', '<']) {
        return None;
    }
    let operands = columns.next().unwrap_or_default();
    let operands = operands.split('@').next().unwrap_or_default().trim();
    Some((
        address,
        Instruction {
            mnemonic: mnemonic.to_owned(),
            operands: operands.to_owned(),
        },
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instruction(line: &str) -> Instruction {
        parse(line).expect("an instruction").1
    }

    #[test]
    fn lines_of_the_disassembler() {
        let call = " 80001b0: f00f fc4e    \tbl\t0x800fa50 <__pre_init>  @ imm = #0xf89c";
        let (address, call) = parse(call).unwrap();
        assert_eq!((address, call.target()), (0x80001b0, Some(0x800_fa50)));
        let compare =
            instruction(" 80001b0: b1a2         \tcbz\tr2, 0x80001dc <x+0x40> @ imm = #0x28");
        assert_eq!(compare.target(), Some(0x800_01dc));
        assert_eq!(
            instruction(" 8000220: eeb1 0ac0    \tvsqrt.f32\ts0, s0").target(),
            None
        );
        assert_eq!(parse(" 8000400: 00 01 02 03  \t.word\t0x03020100"), None);
        assert_eq!(parse("08000220 <main>:"), None);
    }

    #[test]
    fn branches() {
        let is_branch = |mnemonic: &str| {
            let operands = "0x8000000".to_owned();
            Instruction {
                mnemonic: mnemonic.to_owned(),
                operands,
            }
            .is_branch()
        };
        for mnemonic in [
            "b", "b.w", "bl", "bx", "blx", "bne", "bls", "ble.w", "blo", "bxeq", "bleq",
        ] {
            assert!(is_branch(mnemonic), "{mnemonic}");
        }
        for mnemonic in ["bic", "bfi", "bkpt", "bics.w", "add", "blend"] {
            assert!(!is_branch(mnemonic), "{mnemonic}");
        }
    }
}
