//! Recordings that the core itself made: `replay` gives the same bits, and its memory does not grow with the
//! file.

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::{BufRead as _, Cursor, Read};

use judges::frames::words;
use simulator::scene::{Exposure as Light, Sensor as Kind, file};
use slitrange::base::exposure::Exposure;
use slitrange::base::places::PLACES;
use slitrange::centre::spot_shape::COMPONENTS;
use slitrange::spot::choice::SpotChoice;
use slitrange_device::protocol::packet::RowHead;
use slitrange_tool::recording::{Reader, Row, Sensor, Writer};

use crate::command::*;

/// Counts the bytes that this thread has allocated, and the most of them at a time.
struct Counted;

thread_local! {
    static ALLOCATED: Cell<usize> = const { Cell::new(0) };
    static MOST: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: the system's allocator does all work; the counts allocate nothing.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let now = ALLOCATED.get().saturating_add(layout.size());
        ALLOCATED.set(now);
        MOST.set(MOST.get().max(now));
        // SAFETY: the caller keeps the contract of `GlobalAlloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        // Other threads may have allocated it.
        ALLOCATED.set(ALLOCATED.get().saturating_sub(layout.size()));
        // SAFETY: as above.
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static COUNTED: Counted = Counted;

/// Random spots, from lost in the noise to saturated, anywhere and beyond the edges.
const RANDOM_SPOTS: &str = "random spots";

/// The scenes of the folder that this sensor can see.
pub fn scenes() -> Vec<String> {
    let mut names = file::names().expect("the folder of scenes");
    names.retain(|name| Scene::load(name).expect("a scene").sensor == Kind::Tcd1304dg);
    names
}

/// Narrow or wide, dim or saturated.
pub fn any_spot(random: &mut ChaCha8Rng) -> Spot {
    Spot {
        width: random.random_range(0.8_f64.ln()..130_f64.ln()).exp(),
        counts_per_second: random.random_range(4_f64.ln()..12_000_f64.ln()).exp(),
    }
}

/// The words of the read-out of some rows.
fn rows_of(name: &str, seed: u64, count: u64) -> Vec<(Option<Exposure>, Vec<u16>)> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let scene = match name {
        RANDOM_SPOTS => Scene::white_paper(),
        name => Scene::load(name).expect("a scene"),
    };
    let simulation = Simulation::new(Scene { seed, ..scene });
    let geometry = tcd1304dg();
    let read_out = |row| {
        // In one row of sixteen the laser is off.
        let us = random.random_range(10..=5600);
        let exposure = Exposure::from_us(us).filter(|_| random.random_range(0..16) > 0);
        let laser = exposure.map_or(0.0, |it| 1e-6 * f64::from(it.us()));
        let light = if name == RANDOM_SPOTS {
            let mut scene = simulation.scene().clone();
            scene.spot = Some(any_spot(&mut random));
            scene.row_with_centre(row, random.random_range(-20.0..3668.0), 1.0)
        } else {
            let light = Light {
                row: 5.7e-3,
                laser,
                laser_before: laser,
            };
            simulation.row(row, simulation.scene().distance, light)
        };
        // The first words of a read-out show no pixel.
        let mut row = vec![geometry.full_scale(); TCD1304DG_LEAD_IN];
        row.extend(words(&light, &geometry));
        row.resize(geometry.words, geometry.full_scale());
        (exposure, row)
    };
    (1..=count).map(read_out).collect()
}

/// The sensor's own spot, if its calibration knows it.
fn profile() -> Profile {
    Profile {
        first: Pixels::from_int(1000),
        last: Pixels::from_int(2600),
        width: [Pixels::from_f32(8.5); PLACES],
        width_deviation: Pixels::from_f32(0.01),
        components: [[Pixels::from_f32(0.03); PLACES]; COMPONENTS],
        deviation: Pixels::from_f32(0.001),
    }
}

/// What a sensor would report of rows: the core measures each one, with settings that no packet carried.
fn recorded(
    settings: Settings,
    profile: Option<Profile>,
    rows: impl IntoIterator<Item = (Option<Exposure>, Vec<u16>)>,
) -> (Sensor, Vec<Row>) {
    let record = with(Record::nominal().expect("a record"), |it| {
        it.profile = profile
    });
    let mut measurement = Measurement::new(tcd1304dg(), settings.options());
    measurement.set(settings.options(), profile);
    measurement.set_comb(Comb::nominal());
    let row = |(place, (exposure, words)): (usize, (Option<Exposure>, Vec<u16>))| Row {
        head: RowHead {
            // Eleven rows are read while one is sent.
            number: 11 * place as u32,
            skipped: 10,
            time_us: 62_700 * place as u64,
            exposure,
            words: words.len() as u16,
            result: measurement.measure_alone(&mut words.clone(), exposure, None),
        },
        words,
    };
    let sensor = Sensor {
        head: "TCD1304DG".to_owned(),
        settings,
        record: EncodedRecord::new(record).expect("a record"),
        is_calibration_on: true,
    };
    (sensor, rows.into_iter().enumerate().map(row).collect())
}

/// `slitrange replay` of a file whose rows give the sensor's bits: what it says.
fn replay(path: &Path, more: &[&str]) -> String {
    let words = [&["replay", path.to_str().expect("a path")], more].concat();
    let (code, said) = slitrange(&RealPc::default(), &words, "");
    assert_eq!(code, Ok(ExitCode::SUCCESS), "{said}");
    said
}

/// Each estimator, and each setting that changes what a row gives.
#[test]
fn rows_of_all_scenes_replay_bit_by_bit() {
    let directory = tempfile::tempdir().expect("a directory");
    let default = Settings::default();
    let of = |change: &dyn Fn(&mut Settings)| {
        let mut settings = default;
        change(&mut settings);
        (settings, None)
    };
    let estimators = Estimator::ALL.into_iter();
    let mut all: Vec<_> = estimators.map(|it| of(&|set| set.estimator = it)).collect();
    let region = Region::new(600, 3000).expect("a region");
    all.extend([
        of(&|set| (set.black_level, set.peak) = (BlackLevel::Frame, SpotChoice::First)),
        of(&|set| set.region = region),
        of(&|set| set.slits = Slits::Comb),
        (default, Some(profile())),
    ]);
    let (mut centres, mut faults) = (0, 0);
    for (place, (settings, profile)) in all.into_iter().enumerate() {
        let seed = 31_000 + place as u64;
        let of_scenes = scenes();
        let rows = of_scenes.iter().flat_map(|name| rows_of(name, seed, 6));
        let rows = rows.chain(rows_of(RANDOM_SPOTS, seed, 100));
        let (sensor, rows) = recorded(settings, profile, rows);
        centres += rows.iter().filter(|row| row.head.result.is_ok()).count();
        faults += rows.iter().filter(|row| row.head.result.is_err()).count();
        let mut writer = Writer::default();
        let mut bytes = writer.head(&sensor);
        for row in &rows {
            bytes.extend(writer.row(row));
        }
        let mut reader = Reader::new(&bytes[..]).expect("a recording");
        assert_eq!(reader.sensor, sensor);
        for row in &rows {
            assert_eq!(&reader.next().expect("a row").expect("no error"), row);
        }
        assert!(reader.next().is_none() && reader.damaged == 0);
        let path = directory.path().join(format!("{place}.slitrange"));
        std::fs::write(&path, &bytes).expect("a file");
        println!("{settings:?}");
        let said = replay(&path, &[]);
        begins(&said, &format!("{} rows of TCD1304DG, record ", rows.len()));
        ends(&said, "all rows give the bits that the sensor reported\n");
    }
    println!("{centres} centres and {faults} faults");
    // A test of faults only, or of none, would show little.
    assert!(centres > 500 && faults > 200, "{centres} {faults}");
}

/// The bytes of a recording with so many rows, the same 16 ones again and again.
struct Repeated {
    head: Vec<u8>,
    rows: Vec<Vec<u8>>,
    left: usize,
    now: Cursor<Vec<u8>>,
    total: usize,
}

impl Repeated {
    fn new(rows: usize) -> Self {
        let of = rows_of("quiet-paper", 32_000, 16);
        let (sensor, recorded) = recorded(Settings::default(), None, of);
        let mut writer = Writer::default();
        let head = writer.head(&sensor);
        Self {
            now: Cursor::new(head.clone()),
            head,
            rows: recorded.iter().map(|row| writer.row(row)).collect(),
            left: rows,
            total: 0,
        }
    }
}

impl Read for Repeated {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if self.now.fill_buf()?.is_empty() && self.left > 0 {
            let row = &self.rows[self.left % self.rows.len()];
            self.now.get_mut().clone_from(row);
            self.now.set_position(0);
            self.left -= 1;
        }
        let count = self.now.read(bytes)?;
        self.total += count;
        Ok(count)
    }
}

/// A row is given as soon as its bytes are read, of a recording that never ends.
#[test]
fn rows_are_read_one_after_the_other() {
    let mut endless = Repeated::new(usize::MAX);
    let (head, row) = (endless.head.len(), endless.rows[0].len());
    let mut rows = 0;
    let mut reader = Reader::new(&mut endless).expect("a recording");
    rows += reader.by_ref().take(1000).flatten().count();
    assert_eq!((rows, reader.damaged), (1000, 0));
    drop(reader);
    // The rows, and at most as many bytes again as a buffer of a file has.
    let most = head + 1001 * row + 16 * 1024;
    assert!(endless.total <= most, "{} of {most}", endless.total);
}

/// Without one of its lines, the text could stand for other settings. A row stands for itself.
#[test]
fn damaged_text_is_refused_and_a_damaged_row_is_left_out() {
    let mut bytes = Vec::new();
    let mut file = Repeated::new(4);
    let head = file.head.len();
    file.read_to_end(&mut bytes).expect("bytes");
    for place in (0..head).step_by(7).chain([head - 1]) {
        let mut damaged = bytes.clone();
        damaged[place] ^= 0x10;
        assert!(Reader::new(&damaged[..]).is_err(), "{place} of {head}");
    }
    let first_row = head + 4;
    bytes[first_row] ^= 0x10;
    let mut reader = Reader::new(&bytes[..]).expect("a recording");
    assert_eq!(reader.by_ref().flatten().count(), 3);
    assert_eq!(reader.damaged, 1);
}

/// The most bytes that `replay` of so many rows has allocated at a time, with a table.
fn most_memory(directory: &Path, rows: usize) -> usize {
    let path = directory.join(format!("{rows}.slitrange"));
    let mut file = std::fs::File::create(&path).expect("a file");
    io::copy(&mut Repeated::new(rows), &mut file).expect("a recording");
    let table = directory.join("rows.csv");
    let table = table.to_str().expect("a path");
    let before = ALLOCATED.get();
    MOST.set(before);
    let said = replay(&path, &["--csv", table]);
    let most = MOST.get() - before;
    begins(&said, &format!("{rows} rows of "));
    std::fs::remove_file(&path).expect("the file");
    let lines = std::fs::read_to_string(table).expect("a table");
    assert_eq!(lines.lines().count(), rows + 1);
    most
}

fn assert_memory_is_constant(few: usize, many: usize) {
    let directory = tempfile::tempdir().expect("a directory");
    let [of_few, of_many] = [few, many].map(|rows| most_memory(directory.path(), rows));
    println!("at most {of_few} bytes for {few} rows, {of_many} bytes for {many}");
    // The numbers of the report have more digits.
    assert!(of_many <= of_few + 1024, "{of_few} {of_many}");
}

#[test]
fn the_memory_of_replay_does_not_grow_with_the_file() {
    assert_memory_is_constant(20, 2000);
}

#[test]
#[ignore = "a file of 0.6 GB; .ci/run runs it"]
fn a_hundred_thousand_rows_take_the_memory_of_twenty() {
    assert_memory_is_constant(20, 100_000);
}
