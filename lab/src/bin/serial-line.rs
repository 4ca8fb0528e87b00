//! Writes the reference of commands, settings and faults into docs/serial-line.md.

fn main() -> anyhow::Result<()> {
    let (_, expected) = lab::serial_line::found_and_expected()?;
    std::fs::write(lab::serial_line::page(), expected)?;
    Ok(())
}
