//! The live table on a terminal.

use std::sync::mpsc::Receiver;

use gearwatch_core::verdict::MachineState;
use gearwatch_daemon::fleet::{Fleet, Notice};
use gearwatch_daemon::states::BenchCondition::{Machine, NotOk, Silent, Stopped};
use ratatui::Frame;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyModifiers};
use ratatui::layout::Constraint;
use ratatui::style::{Color, Modifier, Style};
use ratatui::widgets::{Block, Row, Table, TableState};

use super::{COLUMNS, TICK, now_ns, row};
use crate::exit::Exit;

/// The table and what is known.
pub(super) struct Screen {
    server: String,
    link: String,
    view: Fleet,
    selected: TableState,
}

impl Screen {
    pub(super) fn new(server: String) -> Self {
        Self { server, link: "connecting".to_owned(), view: Fleet::default(), selected: TableState::default() }
    }

    /// Draws until q, Esc or Ctrl-C.
    pub(super) fn run(mut self, notices: &Receiver<Notice>) -> anyhow::Result<Exit> {
        let mut terminal = ratatui::init();
        let result = loop {
            while let Ok(notice) = notices.try_recv() {
                self.take(notice);
            }
            if let Err(error) = terminal.draw(|frame| self.draw(frame)) {
                break Err(error.into());
            }
            match self.left() {
                Ok(false) => {}
                Ok(true) => break Ok(Exit::Ok),
                Err(error) => break Err(error.into()),
            }
        };
        ratatui::restore();
        result
    }

    fn take(&mut self, notice: Notice) {
        match notice {
            Notice::Letter(heard) => drop(self.view.take(&heard)),
            Notice::Connected => self.link = "reading what was said".to_owned(),
            Notice::CaughtUp => self.link = "live".to_owned(),
            Notice::Lost(error) => self.link = format!("away: {error}"),
        }
    }

    /// Whether a key says to leave; the arrows move the selection.
    fn left(&mut self) -> std::io::Result<bool> {
        if !event::poll(TICK)? {
            return Ok(false);
        }
        let Event::Key(key) = event::read()? else { return Ok(false) };
        match key.code {
            KeyCode::Char('q') | KeyCode::Esc => return Ok(true),
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => return Ok(true),
            KeyCode::Down => self.selected.select_next(),
            KeyCode::Up => self.selected.select_previous(),
            _ => {}
        }
        Ok(false)
    }

    fn draw(&mut self, frame: &mut Frame<'_>) {
        let now = now_ns();
        let rows = self.view.benches.iter().map(|(name, bench)| {
            let colour = match bench.condition(now) {
                Machine(MachineState::Normal) => Color::Green,
                Machine(MachineState::Deviating | MachineState::PathChanged) => Color::Yellow,
                Machine(MachineState::Alarm) => Color::Red,
                Machine(MachineState::Unknown) | Stopped | Silent | NotOk => Color::Magenta,
            };
            Row::new(row(name, bench, now)).style(Style::new().fg(colour))
        });
        let widths = [20, 13, 16, 9, 11, 10, 8].map(Constraint::Length).into_iter().chain([Constraint::Min(10)]);
        let title = format!(" gearwatch fleet: {} benches at {}, {} ", self.view.benches.len(), self.server, self.link);
        let table = Table::new(rows, widths)
            .header(Row::new(COLUMNS).style(Style::new().add_modifier(Modifier::BOLD)))
            .row_highlight_style(Style::new().add_modifier(Modifier::REVERSED))
            .block(Block::bordered().title(title).title_bottom(" ↑ ↓ scroll, q leaves "));
        frame.render_stateful_widget(table, frame.area(), &mut self.selected);
    }
}
