//! `gearwatch top`: the running service on a terminal.

mod feed;
mod screen;

use std::io::IsTerminal;
use std::sync::mpsc;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::Args;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};

use super::Run;
use crate::exit::Exit;
use crate::page::PageAccess;
use feed::{Feed, SILENCE};
use screen::Screen;

/// Watch the running service on a terminal
///
/// Shows each stage and channel with its ranks over time, the deviations of the selected one, and
/// the alarms. Keys: ↑ ↓ select a row, tab moves to the alarms and back, a acknowledges the
/// selected entry, q leaves. The service is not touched by leaving.
#[derive(Args)]
#[command(after_help = "Examples:\n  gearwatch top\n  gearwatch top --url http://127.0.0.1:8650\n  \
                  gearwatch top --url https://bench-3:8650 --ca-file ca.pem --token-file page.token")]
pub struct Top {
    /// Address of the service's page
    #[arg(long, default_value = "http://127.0.0.1:8650")]
    url: String,
    #[command(flatten)]
    access: PageAccess,
}

/// How long the screen waits for a key before it looks at the data again.
const TICK: Duration = Duration::from_millis(100);

impl Run for Top {
    const NAME: &'static str = "top";

    fn run(self) -> anyhow::Result<Exit> {
        if !std::io::stdout().is_terminal() {
            bail!("standard output is not a terminal; `gearwatch status` prints the state of the service as text");
        }
        let (sender, receiver) = mpsc::sync_channel(4096);
        let page = self.access.page(&self.url, SILENCE)?;
        let mut screen = Screen::new(page.url().to_owned());
        let feed = Feed::start(page, sender).context("the reader could not be started")?;
        let mut terminal = ratatui::init();
        let result = loop {
            while let Ok(message) = receiver.try_recv() {
                screen.take(message);
            }
            if let Err(error) = terminal.draw(|frame| screen.draw(frame)) {
                break Err(error.into());
            }
            match next_key() {
                Ok(None) => {}
                Ok(Some(KeyCode::Char('q') | KeyCode::Esc)) => break Ok(Exit::Ok),
                Ok(Some(KeyCode::Char('a'))) => {
                    for id in screen.selected_alarms() {
                        screen.say(feed.acknowledge(&id));
                    }
                }
                Ok(Some(key)) => screen.key(key),
                Err(error) => break Err(error.into()),
            }
        };
        ratatui::restore();
        result
    }
}

/// The next key, with Ctrl-C as `q`; `None` where there is none within a tick.
fn next_key() -> std::io::Result<Option<KeyCode>> {
    if !event::poll(TICK)? {
        return Ok(None);
    }
    Ok(match event::read()? {
        Event::Key(key) if key.kind == KeyEventKind::Press => {
            let interrupt = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
            Some(if interrupt { KeyCode::Char('q') } else { key.code })
        }
        _ => None,
    })
}
