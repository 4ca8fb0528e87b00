//! Several emulated chips at once, each in a thread of its own.

use std::num::NonZero;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

use anyhow::{Context as _, Result};
use slowest_on_chip::mailbox::Question;

use super::chip::Chip;

pub struct Chips {
    workers: Vec<Worker>,
}

/// A thread with a chip. It ends when it gets no more questions.
struct Worker {
    questions: Sender<Vec<Question>>,
    counts: Receiver<Result<Vec<u32>>>,
}

impl Chips {
    /// Starts the program of a chip on more chips.
    pub fn like(chip: &Chip) -> Self {
        let cores = thread::available_parallelism().map_or(1, NonZero::get);
        let start = |_| {
            let program = chip.program().clone();
            let (questions, to_count) = channel::<Vec<Question>>();
            let (answer, counts) = channel();
            thread::spawn(move || {
                let mut chip = Chip::with(program, &[]);
                for questions in to_count {
                    let counted = chip.as_mut().map(|chip| chip.count(&questions));
                    let counted = counted.unwrap_or_else(|error| Err(anyhow::anyhow!("{error:#}")));
                    // Nobody waits any more if the search has ended.
                    let _ = answer.send(counted);
                }
            });
            Worker { questions, counts }
        };
        Self {
            workers: (0..cores).map(start).collect(),
        }
    }

    /// Counts the instructions for each row: each chip counts an equal part of them.
    pub fn count(&mut self, questions: &[Question]) -> Result<Vec<u32>> {
        let part = questions.len().div_ceil(self.workers.len()).max(1);
        let parts = questions.chunks(part);
        for (worker, part) in self.workers.iter().zip(parts.clone()) {
            let sent = worker.questions.send(part.to_vec());
            sent.context("a chip has ended")?;
        }
        let mut counts = Vec::with_capacity(questions.len());
        for (worker, _) in self.workers.iter().zip(parts) {
            counts.extend(worker.counts.recv().context("a chip has ended")??);
        }
        Ok(counts)
    }
}
