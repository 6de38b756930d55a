//! What `gearwatch top` shows.

use std::collections::{BTreeMap, VecDeque};

use ratatui::Frame;
use ratatui::crossterm::event::KeyCode;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Borders, Cell, Paragraph, Row, Table};
use serde_json::Value;

use super::feed::Message;

/// Windows kept per row; wider terminals exist, but not by much.
const KEEP: usize = 400;
const HARMONICS: [&str; 5] = ["1x", "2x", "3x", "4x", "5x"];
/// The height of a strip's cell says the rank; the colour says it again.
const HEIGHTS: [&str; 6] = ["▁", "▂", "▃", "▅", "▆", "█"];

#[derive(Default)]
struct Channel {
    last: Value,
    /// Highest level of the five harmonics by window; −1 unknown.
    levels: VecDeque<i64>,
}

impl Channel {
    fn push(&mut self, levels: [i64; 5]) {
        if self.levels.len() == KEEP {
            self.levels.pop_front();
        }
        self.levels.push_back(levels.into_iter().max().unwrap_or(-1));
    }
}

#[derive(PartialEq, Eq)]
enum Focus {
    Rows,
    Alarms,
}

/// The state of the screen.
pub struct Screen {
    url: String,
    link: Result<(), String>,
    status: Value,
    channels: BTreeMap<(String, String, String), Channel>,
    row: usize,
    alarm: usize,
    focus: Focus,
    said: String,
    colours: bool,
}

impl Screen {
    /// An empty screen of the service at `url`.
    pub fn new(url: String) -> Self {
        Self {
            url,
            link: Err("connecting".into()),
            status: Value::Null,
            channels: BTreeMap::new(),
            row: 0,
            alarm: 0,
            focus: Focus::Rows,
            said: String::new(),
            colours: std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty()),
        }
    }

    /// Takes in what the feed read.
    pub fn take(&mut self, message: Message) {
        match message {
            Message::Link(Ok(())) => {
                // The service sends its history again after a reconnect.
                self.channels.clear();
                self.link = Ok(());
            }
            Message::Link(error) => {
                self.link = error;
                // What is no longer heard must not go on looking well.
                self.status = Value::Null;
            }
            Message::Status(status) => self.status = status,
            Message::Past(past) => {
                let channel = self.channel(&past);
                channel.levels.clear();
                let letters = [0, 1, 2, 3, 4].map(|h| past["level"][h].as_str().unwrap_or_default().as_bytes());
                let windows = letters.map(<[u8]>::len).into_iter().min().unwrap_or(0);
                // The newest window comes again by itself.
                for window in windows.saturating_sub(KEEP)..windows.saturating_sub(1) {
                    channel.push(letters.map(|of| char::from(of[window]).to_digit(10).map_or(-1, i64::from)));
                }
            }
            Message::Verdict(verdict) => {
                let channel = self.channel(&verdict);
                channel.push(HARMONICS.map(|h| verdict[format!("level_{h}")].as_i64().unwrap_or(-1)));
                channel.last = verdict;
            }
        }
    }

    fn channel(&mut self, of: &Value) -> &mut Channel {
        let text = |key: &str| of[key].as_str().unwrap_or_default().to_owned();
        self.channels.entry((text("bench"), text("stage"), text("channel"))).or_default()
    }

    /// Shows a sentence in the last line.
    pub fn say(&mut self, text: String) {
        self.said = text;
    }

    /// Moves the selection.
    pub fn key(&mut self, key: KeyCode) {
        let (place, count) = match self.focus {
            Focus::Rows => (&mut self.row, self.channels.len()),
            Focus::Alarms => (&mut self.alarm, alarms(&self.status).len()),
        };
        match key {
            KeyCode::Down | KeyCode::Char('j') => *place = (*place + 1).min(count.saturating_sub(1)),
            KeyCode::Up | KeyCode::Char('k') => *place = place.saturating_sub(1),
            KeyCode::Tab => self.focus = if self.focus == Focus::Rows { Focus::Alarms } else { Focus::Rows },
            _ => {}
        }
    }

    /// Id of the selected alarm, if there is one.
    pub fn selected_alarm(&self) -> Option<String> {
        alarms(&self.status).get(self.alarm).and_then(|alarm| alarm["id"].as_str()).map(str::to_owned)
    }

    fn ink(&self, colour: Color) -> Style {
        if self.colours { Style::new().fg(colour) } else { Style::new() }
    }

    fn rank_ink(&self, level: i64) -> Style {
        self.ink(match level {
            0 => Color::Green,
            1 => Color::LightGreen,
            2 => Color::Yellow,
            3 => Color::LightYellow,
            4 => Color::LightRed,
            5 => Color::Red,
            _ => Color::DarkGray,
        })
    }

    fn state_ink(&self, state: &str) -> Style {
        self.ink(match state {
            "normal" | "ok" => Color::Green,
            "alarm" => Color::Red,
            "unknown" | "" => Color::DarkGray,
            _ => Color::Yellow,
        })
    }

    /// Draws everything.
    pub fn draw(&self, frame: &mut Frame<'_>) {
        let rows = u16::try_from(self.channels.len()).unwrap_or(u16::MAX).saturating_add(3);
        let parts = Layout::vertical([
            Constraint::Length(2),
            Constraint::Max(rows.max(4)),
            Constraint::Length(8),
            Constraint::Min(4),
            Constraint::Length(1),
        ]);
        let [head, table, detail, alarms, foot] = parts.areas(frame.area());
        self.draw_head(frame, head);
        self.draw_rows(frame, table);
        self.draw_detail(frame, detail);
        self.draw_alarms(frame, alarms);
        let keys = "↑↓ select   tab rows/alarms   a acknowledge   q leave";
        let text = if self.said.is_empty() { keys.to_owned() } else { format!("{}   ({keys})", self.said) };
        frame.render_widget(Paragraph::new(text).style(self.ink(Color::DarkGray)), foot);
    }

    fn draw_head(&self, frame: &mut Frame<'_>, area: Rect) {
        let bench = &self.status["benches"][0];
        let text = |key: &str| bench[key].as_str().unwrap_or("unknown").to_owned();
        let number =
            |key: &str, unit: &str| bench[key].as_f64().map_or_else(|| "–".into(), |v| format!("{v:.4} {unit}"));
        let (machine, instrument) = (text("machine"), text("instrument"));
        let link = match &self.link {
            Ok(()) => Span::styled("live", self.ink(Color::Green)),
            Err(why) => Span::styled(format!("lost ({why})"), self.ink(Color::Red)),
        };
        let bold = Style::new().add_modifier(Modifier::BOLD);
        let first = Line::from(vec![
            Span::styled("gearwatch ", bold),
            Span::raw(format!("{}   machine ", bench["name"].as_str().unwrap_or(&self.url))),
            Span::styled(machine.clone(), self.state_ink(&machine).add_modifier(Modifier::BOLD)),
            Span::raw("   instrument "),
            Span::styled(instrument.clone(), self.state_ink(&instrument).add_modifier(Modifier::BOLD)),
            Span::raw("   link "),
            link,
        ]);
        let second = format!(
            "motor {}   brake {}   {}",
            number("motor_speed_hz", "Hz"),
            number("brake_torque_nm", "N m"),
            number("temperature_c", "°C")
        );
        frame.render_widget(Paragraph::new(vec![first, Line::raw(second)]), area);
    }

    fn draw_rows(&self, frame: &mut Frame<'_>, area: Rect) {
        let strip = usize::from(area.width.saturating_sub(58));
        let lines = self.channels.iter().enumerate().map(|(i, ((_, stage, name), channel))| {
            let v = &channel.last;
            let instrument = v["instrument"].as_str().unwrap_or("unknown");
            let machine = v["machine"].as_str().unwrap_or("unknown");
            let state = if instrument == "ok" { machine } else { instrument };
            let mut cells = vec![
                Cell::from(format!("{stage} · {name}")),
                Cell::from(Span::styled(
                    state.replace('_', " "),
                    self.state_ink(if instrument == "ok" { machine } else { "" }),
                )),
            ];
            for h in HARMONICS {
                let level = v[format!("level_{h}")].as_i64().unwrap_or(-1);
                let code = if level < 0 { "?" } else { v[format!("rank_{h}")].as_str().unwrap_or("?") };
                cells.push(Cell::from(Span::styled(code.to_owned(), self.rank_ink(level))));
            }
            let skip = channel.levels.len().saturating_sub(strip);
            let spans: Vec<_> =
                channel.levels.iter().skip(skip).map(|&l| Span::styled(height(l), self.rank_ink(l))).collect();
            cells.push(Cell::from(Line::from(spans)));
            let chosen = i == self.row && self.focus == Focus::Rows;
            Row::new(cells).style(if chosen { Style::new().add_modifier(Modifier::REVERSED) } else { Style::new() })
        });
        let widths = [Constraint::Length(22), Constraint::Length(13)]
            .into_iter()
            .chain([Constraint::Length(3); 5])
            .chain([Constraint::Min(10)]);
        let head = Row::new(["stage · channel", "state", "1x", "2x", "3x", "4x", "5x", "highest rank over time"]);
        let table = Table::new(lines, widths).header(head.style(Style::new().add_modifier(Modifier::BOLD)));
        frame.render_widget(table.block(Block::new().borders(Borders::TOP)), area);
    }

    fn draw_detail(&self, frame: &mut Frame<'_>, area: Rect) {
        let Some(((_, stage, name), channel)) = self.channels.iter().nth(self.row) else { return };
        let v = &channel.last;
        let half = usize::from(area.width.saturating_sub(46)) / 2;
        let lines: Vec<_> = HARMONICS
            .iter()
            .map(|h| {
                let number = |key: String| v[key].as_f64();
                let level = v[format!("level_{h}")].as_i64().unwrap_or(-1);
                let figures = match (number(format!("dev_{h}_percent")), number(format!("dev_sigma_{h}_percent"))) {
                    (Some(d), Some(s)) => format!("{d:+7.2} ± {s:4.2} %"),
                    _ => "      –        ".into(),
                };
                let probability =
                    number(format!("p_{h}")).map_or_else(|| "  –".into(), |p| format!("{:3.0}", 100.0 * p));
                let deviation = number(format!("dev_{h}_percent")).unwrap_or(0.0);
                Line::from(vec![
                    Span::raw(format!("{h}  ")),
                    Span::styled(
                        format!("{:>7}", v[format!("rank_{h}")].as_str().unwrap_or("?")),
                        self.rank_ink(level),
                    ),
                    Span::raw(format!("  {figures}  p {probability} % ")),
                    Span::styled(bar(deviation, half), self.rank_ink(level)),
                ])
            })
            .collect();
        let title = format!(" {stage} · {name}: deviations, full width ±20 % ");
        frame.render_widget(Paragraph::new(lines).block(Block::new().borders(Borders::TOP).title(title)), area);
    }

    fn draw_alarms(&self, frame: &mut Frame<'_>, area: Rect) {
        let lines: Vec<_> = alarms(&self.status)
            .iter()
            .enumerate()
            .map(|(i, alarm)| {
                let text = |key: &str| alarm[key].as_str().unwrap_or_default().to_owned();
                let seen =
                    if alarm["acknowledged"].as_bool() == Some(true) { "acknowledged" } else { "not acknowledged" };
                let line = format!("{:<24} {:<40} {} ({seen})", text("place"), text("what"), text("state"));
                let chosen = i == self.alarm && self.focus == Focus::Alarms;
                Line::styled(line, if chosen { Style::new().add_modifier(Modifier::REVERSED) } else { Style::new() })
            })
            .collect();
        let none = lines.is_empty();
        let body = if none { vec![Line::raw("none")] } else { lines };
        frame.render_widget(Paragraph::new(body).block(Block::new().borders(Borders::TOP).title(" alarms ")), area);
    }
}

fn alarms(status: &Value) -> &[Value] {
    status["benches"][0]["alarms"].as_array().map_or(&[], Vec::as_slice)
}

fn height(level: i64) -> &'static str {
    usize::try_from(level).ok().and_then(|l| HEIGHTS.get(l)).copied().unwrap_or("·")
}

/// A bar from the middle to the left or right, `half` cells for 20 %.
fn bar(deviation_percent: f64, half: usize) -> String {
    let cells = ((deviation_percent.abs() / 20.0 * half as f64).round() as usize).min(half);
    if deviation_percent < 0.0 {
        format!("{}{}│{}", " ".repeat(half - cells), "█".repeat(cells), " ".repeat(half))
    } else {
        format!("{}│{}", " ".repeat(half), "█".repeat(cells))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    #[test]
    fn analytic_bars_grow_from_the_middle() {
        assert_eq!(bar(10.0, 4), "    │██");
        assert_eq!(bar(-20.0, 4), "████│    ");
        assert_eq!(bar(99.0, 4), "    │████");
    }

    /// A lost link must not go on showing a machine in order.
    #[test]
    fn regress_a_lost_link_is_not_normal() {
        let mut screen = Screen::new("http://bench".into());
        screen.take(Message::Link(Ok(())));
        screen.take(Message::Status(
            serde_json::json!({"benches": [{"name": "b", "machine": "normal", "instrument": "ok"}]}),
        ));
        let mut terminal = Terminal::new(TestBackend::new(120, 30)).unwrap();
        let mut shown = |screen: &Screen| {
            terminal.draw(|frame| screen.draw(frame)).unwrap();
            terminal.backend().to_string()
        };
        assert!(shown(&screen).contains("machine normal"));
        screen.take(Message::Link(Err("connection refused".into())));
        let text = shown(&screen);
        assert!(text.contains("machine unknown") && text.contains("lost (connection refused)"), "{text}");
    }
}
