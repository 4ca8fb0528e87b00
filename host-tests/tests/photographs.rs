#[path = "../../virtual-board/src/photograph.rs"]
mod photograph;
use host_tests::accuracy::Cell;
use host_tests::*;
use phase_tables::gaussian;
use photograph::Photograph;
use slitrange::estimator::phase_table::*;
#[test]
fn t() {
    let inf = phase_tables::set(&gaussian, f64::INFINITY);
    let inf = core_tables::borrow(&inf);
    let inf = TableSet::new(&inf).unwrap();
    let mut geometry = Cell {
        width: 1.0,
        amplitude: 1.0,
        read_noise: 0.0,
        electrons_per_count: None,
        rows: 0,
        seed: 0,
    }
    .scene()
    .geometry;
    geometry.words = 3648;
    geometry.light = 0..3648;
    for name in ["TEM00_200mm", "t-580mm", "t-hene"] {
        let p = Photograph::read(format!("/work/shared/data/laser-spots/{name}.pgm")).unwrap();
        let mut e = [vec![], vec![]];
        let mut faults = std::collections::BTreeMap::new();
        let mut wid = 0.0;
        for y in 0..p.height() {
            let row: Vec<u16> = p
                .row(y)
                .unwrap()
                .iter()
                .map(|&v| (u32::from(v) * 4095 / u32::from(p.white())) as u16)
                .collect();
            let left = (3648 - row.len()) / 2;
            let light: Vec<u16> = (0..3648)
                .map(|i| {
                    let j = i as isize - left as isize;
                    if j < 0 {
                        row[(-j) as usize % 32]
                    } else if j as usize >= row.len() {
                        row[row.len() - 1 - (j as usize - row.len()) % 32]
                    } else {
                        row[j as usize]
                    }
                })
                .collect();
            let f: Vec<f64> = row.iter().map(|&v| f64::from(v)).collect();
            match accuracy::centre_of(&geometry, &light, &GAUSSIAN) {
                Ok(c) => {
                    if c.amplitude.to_f64()
                        < std::env::var("AMP").map_or(0.0, |a| a.parse().unwrap())
                        || y == 0
                    {
                        continue;
                    }
                    let Some(g) = least_squares::fit(&f, 4.0) else {
                        println!("nofit {y}");
                        continue;
                    };
                    let k = (c.centre.to_f64() - left as f64 - g.centre) / g.width;
                    let ci = accuracy::centre_of(&geometry, &light, &inf);
                    let Ok(ci) = ci else {
                        println!("{y} inf {ci:?}");
                        continue;
                    };
                    let ki = (ci.centre.to_f64() - left as f64 - g.centre) / g.width;
                    if y % 100 == 0 {
                        println!(
                            "{y} a {:.0} w {:.1} fit w {:.2} k {k:.4} inf {ki:.4} class {:?}",
                            c.amplitude.to_f64(),
                            c.width.to_f64(),
                            g.width,
                            c.class
                        );
                    }
                    wid += g.width;
                    e[0].push(k);
                    e[1].push(ki);
                }
                Err(f) => *faults.entry(f.name()).or_insert(0) += 1,
            }
        }
        for (n, e) in ["r=.3", "inf"].iter().zip(&e) {
            let rms = (e.iter().map(|e| e * e).sum::<f64>() / e.len() as f64).sqrt();
            let max = e.iter().fold(0.0f64, |a, b| a.max(b.abs()));
            println!(
                "{name} {n}: {} rows rms {rms:.5} max {max:.5} sigma; mean width {:.1} {faults:?}",
                e.len(),
                wid / e.len() as f64
            );
        }
    }
}
