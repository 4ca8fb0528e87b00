//! TEMPORARY stub with made-up numbers, to be replaced by the measurement on the emulated chip.

/// What was measured on the chip.
#[allow(dead_code, reason = "temporary")]
pub struct Chip {
    pub rungs: Vec<RungOnChip>,
    pub sweep_instructions_per_pixel: f64,
    pub gauss_newton_instructions_per_iteration: Option<f64>,
    pub peers: Vec<PeerOnChip>,
    pub kernels_compared: u64,
    pub kernels_different: u64,
    pub tracked_sweep_instructions_per_pixel: Option<f64>,
    pub geometry_instructions_per_word: f64,
    pub measurement_instructions_per_row: u64,
    pub distance_instructions: u64,
    pub found: Vec<()>,
}

/// A rung at one width.
#[derive(Clone, Debug)]
#[allow(dead_code, reason = "temporary")]
pub struct RungOnChip {
    pub name: String,
    pub width: f64,
    pub instructions: u64,
    pub instructions_most: u64,
    pub cycles_estimated: u64,
    pub code_bytes: u64,
    pub table_bytes: u64,
    pub stack_bytes: u64,
    pub fault: Option<String>,
}

/// A peer.
#[allow(dead_code, reason = "temporary")]
pub struct PeerOnChip {
    pub name: String,
    pub instructions: u64,
    pub stack_bytes: u64,
}

/// Made-up numbers.
pub fn measure() -> anyhow::Result<Chip> {
    // name, instructions for a 96-tap window, the same for a narrow one, code, tables, stack
    let rungs = [
        ("centroid", 520, 90, 420, 0, 120),
        ("parabola", 95, 95, 300, 0, 80),
        ("log-parabola", 190, 190, 700, 0, 96),
        ("zero-crossing", 204, 110, 380, 0, 96),
        ("blocks", 299, 180, 900, 9400, 260),
        ("phase-table", 354, 150, 1100, 9400, 220),
        ("adaptive", 653, 290, 2300, 18800, 300),
        ("robust", 1420, 520, 3400, 28200, 420),
        ("gauss-newton", 37_600, 9100, 4100, 0, 1400),
        ("fraunhofer", 354, 150, 1100, 9400, 220),
    ];
    Ok(Chip {
        rungs: [1.5, 4.5, 10.5, 11.3, 25.0]
            .into_iter()
            .flat_map(|width: f64| {
                rungs.map(|(name, wide, narrow, code, tables, stack)| {
                    let part = ((width - 1.5) / 9.8).min(1.0);
                    let instructions = (f64::from(narrow) + part * f64::from(wide - narrow)) as u64;
                    RungOnChip {
                        name: name.into(),
                        width,
                        instructions,
                        instructions_most: instructions,
                        cycles_estimated: instructions * 14 / 10,
                        code_bytes: code,
                        table_bytes: tables,
                        stack_bytes: stack,
                        fault: (name == "parabola" && width > 20.0).then(|| "no spot".into()),
                    }
                })
            })
            .collect(),
        sweep_instructions_per_pixel: 2.6,
        gauss_newton_instructions_per_iteration: Some(12_560.0),
        peers: vec![PeerOnChip {
            name: "levenberg-marquardt f32".into(),
            instructions: 623_407,
            stack_bytes: 0,
        }],
        kernels_compared: 0,
        kernels_different: 0,
        tracked_sweep_instructions_per_pixel: None,
        geometry_instructions_per_word: 0.0,
        measurement_instructions_per_row: 0,
        distance_instructions: 0,
        found: vec![],
    })
}

/// Nothing yet.
pub fn on_board() -> anyhow::Result<()> {
    anyhow::bail!("to be written")
}
