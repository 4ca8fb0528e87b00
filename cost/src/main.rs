//! `cargo cost`: what accuracy costs in time.

mod peers;

fn main() -> anyhow::Result<()> {
    let mut peers = peers::run(&peers::Options::default())?;
    let on_chip: [(&str, f64); 0] = [];
    for (name, ratio) in on_chip {
        peers.set_chip_instruction_ratio(name, ratio);
    }
    if std::env::args().any(|argument| argument == "--json") {
        println!("{}", serde_json::to_string_pretty(&peers)?);
    } else {
        print!("{peers}");
    }
    Ok(())
}
