//! A sensor at a PC with a terminal: what is drawn stays in memory, and keys are pressed as a test says.

use ratatui::backend::TestBackend;
use ratatui::{Frame, Terminal};
use slitrange_tool::screen::Screen;

use super::stand_in::StandIn;
use crate::command::*;

/// A person at a terminal of 80 columns and 24 lines, with a sensor.
pub struct Person<'a> {
    sensor: &'a StandIn,
    /// The keys: each after how many pictures since the one before.
    keys: RefCell<VecDeque<(usize, Key)>>,
    /// What the screen showed when a key was pressed.
    seen: RefCell<Vec<String>>,
}

impl<'a> Person<'a> {
    pub fn new(sensor: &'a StandIn, keys: &[(usize, Key)]) -> Self {
        Self {
            sensor,
            keys: RefCell::new(keys.iter().copied().collect()),
            seen: RefCell::default(),
        }
    }

    /// The words of a command line: what the screen showed at each key, and the output.
    pub fn types(&self, line: &str) -> (Vec<String>, String) {
        let output = done(slitrange(self, &self.sensor.words(line), ""));
        (self.seen.take(), output)
    }
}

impl Pc for Person<'_> {
    fn open(&self, port: &str) -> serialport::Result<Box<dyn Port + '_>> {
        self.sensor.open(port)
    }

    fn screen(&self) -> io::Result<Option<Box<dyn Screen + '_>>> {
        let terminal = Terminal::new(TestBackend::new(80, 24)).expect("memory");
        Ok(Some(Box::new(InMemory {
            person: self,
            terminal,
            drawn: 0,
        })))
    }

    fn now(&self) -> Duration {
        self.sensor.now()
    }

    fn sleep(&self, time: Duration) {
        self.sensor.sleep(time);
    }
}

struct InMemory<'a> {
    person: &'a Person<'a>,
    terminal: Terminal<TestBackend>,
    drawn: usize,
}

impl Screen for InMemory<'_> {
    fn draw(&mut self, view: &mut dyn FnMut(&mut Frame<'_>)) -> io::Result<()> {
        self.terminal.draw(|frame| view(frame)).expect("memory");
        self.drawn += 1;
        Ok(())
    }

    fn key(&mut self) -> io::Result<Option<Key>> {
        let mut keys = self.person.keys.borrow_mut();
        let Some((_, key)) = keys.pop_front_if(|(after, _)| self.drawn >= *after) else {
            return Ok(None);
        };
        self.drawn = 0;
        let picture = self.terminal.backend().to_string();
        println!("{picture}");
        self.person.seen.borrow_mut().push(picture);
        Ok(Some(key))
    }
}
