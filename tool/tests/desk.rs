//! A PC whose clock is that of the emulated board, with the board at its only serial port.

use virtual_board::stage::Stage;

use crate::command::*;

/// The board runs for so long at a time.
const STEP: Duration = Duration::from_millis(5);

pub struct Desk {
    pub board: RefCell<VirtualBoard>,
    stage: Option<RefCell<Stage>>,
    /// The bytes that the port has not given yet.
    pending: RefCell<VecDeque<u8>>,
    pub trouble: Trouble,
}

#[derive(Default)]
pub struct Trouble {
    /// A byte of the next command `format binary` is lost.
    pub loses_a_byte: Cell<bool>,
    /// Somebody presses Ctrl-C after so many bytes from the sensor.
    pub interrupted_in: Cell<Option<usize>>,
    /// The port fails after so many bytes from the sensor, and works again.
    pub fails_in: Cell<Option<usize>>,
}

/// Counts down. Whether the count is over.
fn is_over(left: &Cell<Option<usize>>, count: usize) -> bool {
    left.set(left.get().map(|left| left.saturating_sub(count)));
    left.get() == Some(0)
}

impl Desk {
    /// A board that runs, and what moves its target.
    pub fn new(board: VirtualBoard, stage: Option<Stage>) -> Self {
        Self {
            board: RefCell::new(board),
            stage: stage.map(RefCell::new),
            pending: RefCell::default(),
            trouble: Trouble::default(),
        }
    }

    /// A command line of the tool, split at blanks.
    pub fn run(&self, line: &str) -> Ended {
        println!("$ slitrange {line}");
        let words: Vec<&str> = line.split(' ').collect();
        slitrange(self, &words, "")
    }

    /// Runs the board until a time, or until the port has bytes.
    fn wait(&self, until: Duration, for_port: bool) {
        loop {
            let mut board = self.board.borrow_mut();
            let said = board.take_bytes().into_iter().map(|(_, byte)| byte);
            self.pending.borrow_mut().extend(said);
            // The lines would pile up.
            board.take_lines();
            let left = until.saturating_sub(Duration::from_nanos(board.now()));
            if left.is_zero() || for_port && !self.pending.borrow().is_empty() {
                return;
            }
            if let Some(stage) = &self.stage {
                stage.borrow_mut().look();
            }
            board.run_for(left.min(STEP)).expect("a clean run");
        }
    }
}

impl Pc for Desk {
    fn open(&self, _: &str) -> serialport::Result<Box<dyn Port + '_>> {
        self.board.borrow_mut().take_bytes();
        self.pending.borrow_mut().clear();
        Ok(Box::new(self))
    }

    fn now(&self) -> Duration {
        Duration::from_nanos(self.board.borrow().now())
    }

    fn interrupted(&self) -> bool {
        is_over(&self.trouble.interrupted_in, 0)
    }

    fn sleep(&self, time: Duration) {
        self.wait(self.now() + time, false);
    }
}

impl Port for &Desk {
    fn read(&mut self, bytes: &mut [u8], wait: Duration) -> io::Result<usize> {
        self.wait(self.now() + wait, true);
        let count = io::Read::read(&mut *self.pending.borrow_mut(), bytes)?;
        if count == 0 {
            return Err(io::ErrorKind::TimedOut.into());
        }
        is_over(&self.trouble.interrupted_in, count);
        if is_over(&self.trouble.fails_in, count) {
            self.trouble.fails_in.set(None);
            return Err(io::ErrorKind::BrokenPipe.into());
        }
        Ok(count)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        if let Some(stage) = &self.stage {
            stage.borrow_mut().look();
        }
        let mut bytes = bytes.to_vec();
        let binary = b"format binary";
        let is_binary = bytes.windows(binary.len()).any(|it| it == binary);
        if is_binary && self.trouble.loses_a_byte.take() {
            bytes.remove(bytes.len() / 2);
        }
        let mut board = self.board.borrow_mut();
        let now = board.now();
        board.send_at(now, &bytes);
        Ok(())
    }
}
