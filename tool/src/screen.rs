//! The terminal as a screen that is drawn again and again, and its keys. Tests draw into memory. Errors are
//! those of the terminal.

use std::io;
use std::time::Duration;

use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use ratatui::style::Color;
use ratatui::symbols::Marker;
use ratatui::widgets::{Dataset, GraphType};
use ratatui::{DefaultTerminal, Frame};

/// A key that a view understands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// A letter, a digit or a sign.
    Char(char),
    /// The arrow up.
    Up,
    /// The arrow down.
    Down,
    /// The end: q, Esc or Ctrl-C.
    Quit,
}

/// A screen with a keyboard.
pub trait Screen {
    /// Draws the screen.
    fn draw(&mut self, view: &mut dyn FnMut(&mut Frame<'_>)) -> io::Result<()>;

    /// The next key that was pressed. Does not wait.
    fn key(&mut self) -> io::Result<Option<Key>>;
}

/// A line through points.
pub(crate) fn line(points: &[(f64, f64)], colour: Color) -> Dataset<'_> {
    let line = Dataset::default().graph_type(GraphType::Line);
    line.marker(Marker::Braille).style(colour).data(points)
}

/// The terminal of this program. It is as before once this is dropped, also after a panic.
pub struct RealScreen(DefaultTerminal);

impl RealScreen {
    /// Takes the terminal.
    pub fn new() -> io::Result<Self> {
        ratatui::try_init().map(Self)
    }
}

impl Drop for RealScreen {
    fn drop(&mut self) {
        ratatui::restore();
    }
}

impl Screen for RealScreen {
    fn draw(&mut self, view: &mut dyn FnMut(&mut Frame<'_>)) -> io::Result<()> {
        self.0.draw(|frame| view(frame)).map(|_| ())
    }

    fn key(&mut self) -> io::Result<Option<Key>> {
        while event::poll(Duration::ZERO)? {
            let Event::Key(key) = event::read()? else {
                continue;
            };
            if key.kind == KeyEventKind::Release {
                continue;
            }
            let is_control = key.modifiers.contains(KeyModifiers::CONTROL);
            return Ok(Some(match key.code {
                KeyCode::Char('c') if is_control => Key::Quit,
                KeyCode::Char('q') | KeyCode::Esc => Key::Quit,
                KeyCode::Char(char) => Key::Char(char),
                KeyCode::Up => Key::Up,
                KeyCode::Down => Key::Down,
                _ => continue,
            }));
        }
        Ok(None)
    }
}

/// Breaks a text into lines of at most so many characters, between words. A longer word is a line.
pub fn wrap(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) if line.len() + 1 + word.len() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}
