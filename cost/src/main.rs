//! `cargo cost`: what accuracy costs in time.

mod chip;

fn main() -> anyhow::Result<()> {
    if std::env::args().any(|argument| argument == "--board") {
        return chip::on_board();
    }
    let chip = chip::measure()?;
    for rung in &chip.rungs {
        println!(
            "{:>14} width {:5} instructions {:6} most {:6} cycles {:6} code {:6} tables {:6} stack {:5} {}",
            rung.name,
            rung.width,
            rung.instructions,
            rung.instructions_most,
            rung.cycles_estimated,
            rung.code_bytes,
            rung.table_bytes,
            rung.stack_bytes,
            rung.fault.as_deref().unwrap_or_default(),
        );
    }
    println!(
        "{:#?}",
        chip::Chip {
            rungs: Vec::new(),
            found: Vec::new(),
            ..chip
        }
    );
    Ok(())
}
