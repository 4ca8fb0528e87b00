//! The emulated chip with the program of `slowest-on-chip`.

use slowest_on_chip::mailbox::{QUESTIONS, Question, READY};
use virtual_board::PIXELS;
use virtual_board::board::Conditions;
use virtual_board::trace::Call;

use crate::prelude::*;

/// The chip's clock after a reset, which the program leaves as it is: with one instruction a cycle, the
/// program's cycle counter counts instructions.
const RC_OSCILLATOR_HZ: u64 = 16_000_000;

pub struct Chip {
    program: Firmware,
    board: VirtualBoard,
    asked: u64,
    words: u64,
    counted: u64,
}

impl Chip {
    pub fn power_on() -> Result<Self> {
        Self::power_on_for("thumbv7em-none-eabihf")
    }

    /// With the program built for a target, whose instructions the emulated chip has too.
    pub fn power_on_for(target: &str) -> Result<Self> {
        Self::with(Firmware::build_package_for(target, "slowest-on-chip")?, &[])
    }

    pub(super) fn with(program: Firmware, traced: &[u64]) -> Result<Self> {
        let conditions = Conditions {
            instructions_per_second: RC_OSCILLATOR_HZ,
            ..Conditions::default()
        };
        let mut board =
            VirtualBoard::power_on_under(&program, Box::new(|_| vec![0.0; PIXELS]), conditions)?;
        for function in traced {
            board.trace_calls_of(*function);
        }
        let mut chip = Self {
            asked: program.address_of("ASKED")?,
            words: program.address_of("ASKED_WORDS")?,
            counted: program.address_of("COUNTED")?,
            program,
            board,
        };
        chip.wait()?;
        Ok(chip)
    }

    pub fn count(&mut self, questions: &[Question]) -> Result<Vec<u32>> {
        let mut counts = Vec::with_capacity(questions.len());
        for questions in questions.chunks(QUESTIONS) {
            let words = questions.iter().flat_map(Question::to_words).collect();
            self.board.write_words(self.words, words)?;
            self.board
                .write_words(self.asked, vec![questions.len() as u32])?;
            self.wait()?;
            counts.extend(self.board.read_words(self.counted, questions.len())?);
        }
        Ok(counts)
    }

    fn wait(&mut self) -> Result<()> {
        // 100 s are 1.7e10 instructions.
        for _ in 0..20_000 {
            self.board.run_for(Duration::from_millis(5))?;
            if self.board.read_word(self.asked)? == READY {
                return Ok(());
            }
        }
        bail!("no answer; the log: {:?}", self.board.take_log())
    }

    /// The instructions that are executed for a row, on a board of its own: the emulator must know
    /// before the first instruction what it traces.
    pub fn trace(&self, question: &Question) -> Result<Call> {
        let row = self.program.address_of("slowest_row")?;
        let mut chip = Self::with(self.program.clone(), &[row])?;
        chip.count(std::slice::from_ref(question))?;
        let mut calls = chip.board.take_calls();
        ensure!(calls.len() == 1, "{} calls", calls.len());
        Ok(calls.remove(0))
    }

    pub fn program(&self) -> &Firmware {
        &self.program
    }

    pub fn finish(self) -> Result<()> {
        self.board.finish().map(|_| ())
    }
}
