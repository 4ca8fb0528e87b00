//! TEMPORARY stub with made-up numbers, to be replaced by the measurement of the peers.

/// How to run the peers.
#[derive(Default)]
pub struct Options {}

/// What came of it.
pub struct Peers {
    pub peers: Vec<Peer>,
}

/// A peer beside the default rung.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Peer {
    pub name: String,
    pub host_time_ratio: Option<f64>,
    pub chip_instruction_ratio: Option<f64>,
    pub rmse_over_bound: Option<f64>,
}

/// Made-up numbers.
pub fn run(_: &Options) -> anyhow::Result<Peers> {
    let peer = |name: &str, host, chip, rmse| Peer {
        name: name.into(),
        host_time_ratio: host,
        chip_instruction_ratio: chip,
        rmse_over_bound: rmse,
    };
    Ok(Peers {
        peers: vec![
            peer(
                "levenberg-marquardt f32",
                Some(336.0),
                Some(1761.0),
                Some(1.192),
            ),
            peer("scipy L-BFGS-B", Some(66_000.0), None, Some(1.191)),
        ],
    })
}

impl Peers {
    /// Sets a peer's ratio on the chip; false where there is none of that name.
    pub fn set_chip_instruction_ratio(&mut self, name: &str, ratio: f64) -> bool {
        let peer = self.peers.iter_mut().find(|peer| peer.name == name);
        peer.map(|peer| peer.chip_instruction_ratio = Some(ratio))
            .is_some()
    }
}

impl std::fmt::Display for Peers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "made up")
    }
}
