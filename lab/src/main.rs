//! Runs one of the programs that write the figures of slitrange's docs. `.cargo/config.toml` gives each of
//! them an alias: `cargo cost`, `cargo scene` and so on.
#![forbid(unsafe_code)]

fn main() -> anyhow::Result<()> {
    lab::main()
}
