//! Which step of a row an instruction belongs to.
//!
//! The debug information says which functions an instruction lies in, inlined functions included. The trace
//! says which calls were under way. Together they are the chain of functions from the traced function to the
//! instruction. The outermost function of a step's module decides: so a division, or a copy of memory, counts
//! for the step that needed it.

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

use addr2line::gimli::{EndianSlice, LittleEndian};
use addr2line::{Context, LookupResult, gimli};
use object::{Object as _, ObjectSection as _};
use rustc_demangle::demangle;
use virtual_board::trace::Call;

use crate::prelude::*;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Words into a row, and its black level.
    Convert,
    Search,
    Estimate,
    /// The comparison with the mirror image, and the repair.
    Check,
    /// The row joins its frame, and what connects the steps.
    Frame,
    /// A distance: a row has none, unless it completes a frame.
    Distance,
    Other,
}

pub const NAMES: [&str; 7] = [
    "convert", "search", "estimate", "check", "frame", "distance", "other",
];

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Steps(pub [u64; 7]);

impl Steps {
    /// The instructions of a call by step. `functions` names the functions that an instruction lies in, the
    /// outermost first.
    fn of(call: &Call, functions: impl Fn(u64) -> Rc<[String]>) -> Self {
        let mut steps = Self::default();
        for (sites, executed) in &call.stacks {
            // What called, and the start of what was called: a function that is jumped to in its turn is a
            // part of the latter.
            let under_way: Vec<Rc<[String]>> = sites
                .iter()
                .flat_map(|&(site, function)| [functions(site), functions(function)])
                .collect();
            for (&address, &times) in executed {
                let inside = functions(address);
                let chain = under_way.iter().chain([&inside]);
                let step = step_of(chain.flat_map(|names| names.iter().map(String::as_str)));
                steps.0[step as usize] += times;
            }
        }
        steps
    }

    pub fn total(&self) -> u64 {
        self.0.iter().sum()
    }

    pub fn frame(&self) -> u64 {
        self.0[Step::Frame as usize]
    }
}

/// How much a function's name says of the step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Says {
    /// All that the function calls belongs to the step.
    All(Step),
    /// What the function does itself belongs to the step. It calls other steps too.
    Own(Step),
}

/// The step of a chain of functions, the outermost first.
fn step_of<'a>(chain: impl Iterator<Item = &'a str>) -> Step {
    let mut own = Step::Other;
    for name in chain {
        match says(name) {
            Some(Says::All(step)) => return step,
            Some(Says::Own(step)) => own = step,
            None => {}
        }
    }
    own
}

fn says(function: &str) -> Option<Says> {
    // Of a method, what its type is: `<slitrange::row::Geometry>::row`.
    let name = function.trim_start_matches(['<', '&']);
    let name = name.strip_prefix("mut ").unwrap_or(name);
    let path = name.split([' ', '<', '>', '(', ',']).next()?;
    let mut modules = path.split("::").filter(|part| !part.starts_with('{'));
    if modules.next()? != "slitrange" {
        return STARTS.contains(&name).then_some(Says::Own(Step::Frame));
    }
    let says = match modules.next()? {
        "row" => Says::All(Step::Convert),
        "light" if modules.next() == Some("black_level") => Says::All(Step::Convert),
        "spot" => Says::All(Step::Search),
        "centre" => match modules.next() {
            // Whether a centre is to be trusted.
            Some("flat_top" | "spot_shape") => Says::All(Step::Check),
            Some("estimate" | "estimate_robustly" | "Estimate") => Says::Own(Step::Estimate),
            _ => Says::All(Step::Estimate),
        },
        "check" => Says::All(Step::Check),
        "measurement" => match modules.next() {
            // They call an estimator, for the repair.
            Some("repair_or_keep" | "robust_centre") => Says::All(Step::Check),
            Some("centre_of_spot" | "centre_of_image") => Says::Own(Step::Check),
            _ => Says::Own(Step::Frame),
        },
        "frame" if modules.next() == Some("comb") => match modules.next() {
            Some("images") => Says::Own(Step::Frame),
            Some("combination") => Says::All(Step::Frame),
            _ => Says::All(Step::Search),
        },
        "frame" => Says::All(Step::Frame),
        "distance" | "reading" => Says::All(Step::Distance),
        _ => return None,
    };
    Some(says)
}

/// The functions that are traced, on the chip.
pub const ROW: &str = "step_measurement_row";
pub const READING: &str = "step_reading";
const STARTS: [&str; 2] = [ROW, READING];

type Slice<'a> = EndianSlice<'a, LittleEndian>;

/// What a program's debug information says of its instructions.
pub struct Functions<'a> {
    debug: Context<Slice<'a>>,
    known: RefCell<HashMap<u64, Rc<[String]>>>,
    /// The files of `core/src` whose functions were looked up, but for those of `base`.
    files: RefCell<BTreeSet<String>>,
}

impl<'a> Functions<'a> {
    pub fn of(firmware: &'a Firmware) -> Result<Self> {
        let elf = object::File::parse(firmware.bytes())?;
        let section = |id: gimli::SectionId| {
            let section = elf.section_by_name(id.name());
            let bytes = section.map_or(Ok(&[][..]), |section| section.data())?;
            Ok::<_, anyhow::Error>(EndianSlice::new(bytes, LittleEndian))
        };
        let debug = Context::from_dwarf(gimli::Dwarf::load(section)?)
            .context("the debug information of the chip's program")?;
        Ok(Self {
            debug,
            known: RefCell::default(),
            files: RefCell::default(),
        })
    }

    /// The core's files that the calls up to now lie in, but for those of `base`.
    pub fn core_files(&self) -> BTreeSet<String> {
        self.files.borrow().clone()
    }

    pub fn steps(&self, call: &Call) -> Result<Steps> {
        let sites = call.stacks.keys().flatten();
        let called = sites.flat_map(|&(site, function)| [site, function]);
        let executed = call.stacks.values().flat_map(|executed| executed.keys());
        for address in called.chain(executed.copied()) {
            self.look_up(address)
                .with_context(|| format!("the functions at {address:#x}"))?;
        }
        let known = self.known.borrow();
        let steps = Steps::of(call, |address| Rc::clone(&known[&address]));
        if steps.total() != call.instructions() {
            bail!(
                "the steps have {} instructions, and the call {}",
                steps.total(),
                call.instructions()
            );
        }
        Ok(steps)
    }

    /// The functions that an instruction lies in, the outermost first.
    fn look_up(&self, address: u64) -> Result<()> {
        if self.known.borrow().contains_key(&address) {
            return Ok(());
        }
        let LookupResult::Output(frames) = self.debug.find_frames(address) else {
            bail!("it is in another file");
        };
        let (mut frames, mut names) = (frames?, vec![]);
        while let Some(frame) = frames.next()? {
            if let Some(function) = frame.function {
                names.push(format!("{:#}", demangle(&function.raw_name()?)));
            }
            let file = frame.location.and_then(|it| it.file).unwrap_or_default();
            if let Some((home, file)) = file.split_once("/core/src/")
                && !home.ends_with("/library")
                && !file.starts_with("base/")
            {
                self.files.borrow_mut().insert(file.to_owned());
            }
        }
        names.reverse();
        self.known.borrow_mut().insert(address, names.into());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    fn step(chain: &[&str]) -> Step {
        step_of(chain.iter().copied())
    }

    const START: [&str; 2] = [ROW, "<slitrange::measurement::Measurement>::row"];

    fn within(chain: &[&str]) -> Step {
        step(&[&START, chain].concat())
    }

    #[test]
    fn the_outermost_step_decides() {
        assert_eq!(within(&[]), Step::Frame);
        const FIT: &str = "slitrange::measurement::centre_of_spot > slitrange::centre::estimate > \
             slitrange::centre::phase_table::centre";
        const REPAIR: &str = "slitrange::measurement::centre_of_spot > \
             slitrange::measurement::repair_or_keep::{closure#0} > slitrange::centre::estimate_robustly > \
             slitrange::centre::gauss_newton::fit::fit > compiler_builtins::mem::memcpy";
        let closure = "<&mut slitrange::spot::search::{closure#0} as F>::call";
        let of_frame = "<slitrange::frame::Frame>::add > <slitrange::centre::RowCentre>::x";
        let kept = "slitrange::measurement::centre_of_spot > core::ptr::read";
        for (chain, expected) in [
            ("<slitrange::row::Geometry>::row > memcpy", Step::Convert),
            ("slitrange::spot::search > slitrange::row::x", Step::Search),
            (FIT, Step::Estimate),
            (REPAIR, Step::Check),
            (kept, Step::Check),
            (of_frame, Step::Frame),
            (closure, Step::Search),
            ("slitrange::base::units::x", Step::Frame),
        ] {
            let functions: Vec<&str> = chain.split(" > ").collect();
            assert_eq!(within(&functions), expected, "{chain}");
        }
    }

    #[test]
    fn other_functions_have_no_step() {
        assert_eq!(
            step(&["main", "slitrange_tool::row::x", "memcpy"]),
            Step::Other
        );
        assert_eq!(step(&[]), Step::Other);
    }

    /// The traced function at 1, the estimator at 2 and a copy of memory at 3, which the conversion at 4 and
    /// the estimator call.
    #[test]
    fn a_function_that_several_steps_call_counts_for_each_of_them() {
        let functions = |address| {
            let names: &[&str] = match address {
                1 => &START[..1],
                2 => &["slitrange::centre::phase_table::adaptive"],
                4 => &["<slitrange::row::Geometry>::row"],
                _ => &["memcpy"],
            };
            names.iter().map(|&name| name.to_owned()).collect()
        };
        let call = Call {
            function: 1,
            steps: BTreeMap::new(),
            stacks: BTreeMap::from([
                (vec![], BTreeMap::from([(1, 10)])),
                (vec![(1, 2)], BTreeMap::from([(2, 200)])),
                (vec![(1, 2), (2, 3)], BTreeMap::from([(3, 30)])),
                (vec![(1, 4)], BTreeMap::from([(4, 4000), (5, 1)])),
                (vec![(1, 4), (4, 3)], BTreeMap::from([(3, 70)])),
                (vec![(1, 3)], BTreeMap::from([(3, 5)])),
            ]),
        };
        let steps = Steps::of(&call, functions);
        assert_eq!(steps, Steps([4071, 0, 230, 0, 15, 0, 0]));
        assert_eq!(steps.total(), 4316);
    }
}
