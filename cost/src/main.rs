//! `cargo cost`: what accuracy costs in time.

mod chip;
mod peers;

fn main() -> anyhow::Result<()> {
    if std::env::args().any(|argument| argument == "--board") {
        return chip::on_board();
    }
    if std::env::args().any(|argument| argument == "--peers") {
        print!("{}", peers::run(&peers::Options::default())?);
        return Ok(());
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
    for peer in &chip.peers {
        println!(
            "{}: {} instructions, stack {}",
            peer.name, peer.instructions, peer.stack_bytes
        );
    }
    println!(
        "sweep {:.3} a pixel, tracked {:?}",
        chip.sweep_instructions_per_pixel, chip.tracked_sweep_instructions_per_pixel
    );
    println!("geometry {:.3} a word", chip.geometry_instructions_per_word);
    println!(
        "gauss-newton {:?} an iteration",
        chip.gauss_newton_instructions_per_iteration
    );
    println!(
        "measurement {} a row, distance {}",
        chip.measurement_instructions_per_row, chip.distance_instructions
    );
    println!("kernels compared {}", chip.kernels_compared);
    Ok(())
}
