//! What `gearwatch top` shows.

use std::collections::{BTreeMap, VecDeque};

use gearwatch_core::speed::RPM_PER_HZ;
use gearwatch_core::verdict::{Code, HARMONICS, HarmonicVerdict, InstrumentState, MachineState, Rank, Verdict};
use ratatui::Frame;
use ratatui::crossterm::event::KeyCode;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Borders, Cell, Paragraph, Row, Table};
use serde_json::Value;

use super::feed::{Judged, Message};

mod faults;

use faults::{faults, in_words};

/// Windows kept per row; wider terminals exist, but not by much.
const KEEP: usize = 400;
/// The height of a strip's cell says the rank; the colour says it again.
const HEIGHTS: [&str; 6] = ["▁", "▂", "▃", "▅", "▆", "█"];

#[derive(Default)]
struct Channel {
    last: Option<Verdict>,
    /// The gravest look of the five harmonics by window, with the rank that it stands for.
    looks: VecDeque<Look>,
}

/// What a rank looks like: its colour says no more than the verdict proves, and a rank that is not
/// sure is dim.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Look {
    /// 0 to 5; −1 unknown, 6 where the path changed.
    colour: i64,
    /// 0 to 5; −1 unknown.
    level: i64,
    sure: bool,
}

const UNKNOWN: Look = Look { colour: -1, level: -1, sure: true };
/// Colour of a path that changed.
const PATH: i64 = 6;

impl Look {
    /// Of a machine state, a level and the probability of its rank.
    fn of(machine: MachineState, level: i64, probability: Option<f64>) -> Self {
        let proven = match machine {
            MachineState::Normal => 0,
            MachineState::Deviating => 3,
            MachineState::Alarm => 5,
            MachineState::PathChanged => PATH,
            MachineState::Unknown => return Self { level, ..UNKNOWN },
        };
        let colour = match level {
            ..0 => -1,
            _ if proven == PATH => PATH,
            _ => level.min(proven),
        };
        // A rank above 0 on a stage that is called normal is not borne out, however probable it is
        // by itself.
        let borne_out = colour != 0 || level == 0;
        Self { colour, level, sure: borne_out && probability.is_some_and(|p| p > 0.5) }
    }

    /// Of a harmonic of a verdict.
    fn in_verdict(verdict: &Verdict, harmonic: &HarmonicVerdict) -> Self {
        Self::of(verdict.machine, harmonic.rank.level().into(), finite(harmonic.rank_probability))
    }
}

impl Channel {
    fn push(&mut self, looks: [Look; 5]) {
        if self.looks.len() == KEEP {
            self.looks.pop_front();
        }
        self.looks.push_back(looks.into_iter().max().unwrap_or(UNKNOWN));
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
                let text = |key: &str| past[key].as_str().unwrap_or_default().to_owned();
                let channel = self.channels.entry((text("bench"), text("stage"), text("channel"))).or_default();
                channel.looks.clear();
                let machine = past["machine"].as_str().unwrap_or_default();
                let letters = [0, 1, 2, 3, 4].map(|h| past["level"][h].as_str().unwrap_or_default().as_bytes());
                let windows = letters.map(<[u8]>::len).into_iter().min().unwrap_or(0).min(machine.len());
                // The newest window comes again by itself.
                for window in windows.saturating_sub(KEEP)..windows.saturating_sub(1) {
                    let state = state_of(machine.as_bytes()[window]);
                    channel.push([0, 1, 2, 3, 4].map(|h| {
                        let level = char::from(letters[h][window]).to_digit(10).map_or(-1, i64::from);
                        Look::of(state, level, past["p"][h][window].as_f64())
                    }));
                }
            }
            Message::Verdict(of) => {
                let Judged { bench, verdict } = *of;
                let key = (bench, verdict.stage.clone(), verdict.channel.clone());
                let channel = self.channels.entry(key).or_default();
                channel.push(verdict.harmonics.each_ref().map(|h| Look::in_verdict(&verdict, h)));
                channel.last = Some(verdict);
            }
        }
    }

    /// Shows a sentence in the last line.
    pub fn say(&mut self, text: String) {
        self.said = text;
    }

    /// Moves the selection.
    pub fn key(&mut self, key: KeyCode) {
        let (place, count) = match self.focus {
            Focus::Rows => (&mut self.row, self.channels.len()),
            Focus::Alarms => (&mut self.alarm, faults(&self.status).len()),
        };
        match key {
            KeyCode::Down | KeyCode::Char('j') => *place = (*place + 1).min(count.saturating_sub(1)),
            KeyCode::Up | KeyCode::Char('k') => *place = place.saturating_sub(1),
            KeyCode::Tab => self.focus = if self.focus == Focus::Rows { Focus::Alarms } else { Focus::Rows },
            _ => {}
        }
    }

    /// Ids of the alarms of the selected entry that nobody has seen.
    pub fn selected_alarms(&self) -> Vec<String> {
        let open = faults(&self.status).get(self.alarm).and_then(|fault| fault["open"].as_array());
        open.into_iter().flatten().filter_map(|id| id.as_str().map(str::to_owned)).collect()
    }

    fn ink(&self, colour: Color) -> Style {
        if self.colours { Style::new().fg(colour) } else { Style::new() }
    }

    fn rank_ink(&self, look: Look) -> Style {
        let style = self.ink(match look.colour {
            0 => Color::Green,
            1 => Color::LightGreen,
            2 => Color::Yellow,
            3 => Color::LightYellow,
            4 => Color::LightRed,
            5 => Color::Red,
            PATH => Color::Magenta,
            _ => Color::DarkGray,
        });
        if look.sure { style } else { style.add_modifier(Modifier::DIM) }
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
        let bench = self.bench_of_row();
        let number =
            |key: &str, unit: &str| bench[key].as_f64().map_or_else(|| "–".into(), |v| format!("{v:.4} {unit}"));
        // Of all benches: one that is in order must not hide another that is not.
        let gravest = |key: &str| self.status["gravest"][key].as_str().unwrap_or("unknown").to_owned();
        let (machine, instrument) = (gravest("machine"), gravest("instrument"));
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
        let rpm = bench["motor_speed_hz"].as_f64().map_or(String::new(), |hz| format!(" ({:.0} rpm)", RPM_PER_HZ * hz));
        let second = format!(
            "motor {}{rpm}   brake {}   {}",
            number("motor_speed_hz", "Hz"),
            number("brake_torque_nm", "N m"),
            number("temperature_c", "°C")
        );
        frame.render_widget(Paragraph::new(vec![first, Line::raw(second)]), area);
    }

    /// The bench of the selected row.
    fn bench_of_row(&self) -> &Value {
        let name = self.channels.keys().nth(self.row).map(|(bench, _, _)| bench.as_str());
        let all = benches(&self.status);
        all.iter().find(|bench| bench["name"].as_str() == name).or(all.first()).unwrap_or(&Value::Null)
    }

    fn draw_rows(&self, frame: &mut Frame<'_>, area: Rect) {
        let several = benches(&self.status).len() > 1;
        let place = |bench: &str, stage: &str, name: &str| match several {
            true => format!("{bench} · {stage} · {name}"),
            false => format!("{stage} · {name}"),
        };
        let lengths = self.channels.keys().map(|(bench, stage, name)| place(bench, stage, name).chars().count());
        let longest = u16::try_from(lengths.max().unwrap_or(0)).unwrap_or(u16::MAX).clamp(22, area.width / 2);
        let strip = usize::from(area.width.saturating_sub(longest + 41));
        let lines = self.channels.iter().enumerate().map(|(i, ((bench, stage, name), channel))| {
            let v = channel.last.as_ref();
            let machine = v.map_or(MachineState::Unknown, |v| v.machine).code();
            let not_ok = v.map(|v| v.instrument).filter(|&state| state != InstrumentState::Ok);
            let state = not_ok.map_or(machine, InstrumentState::code);
            let mut cells = vec![
                Cell::from(place(bench, stage, name)),
                Cell::from(Span::styled(
                    state.replace('_', " "),
                    self.state_ink(if not_ok.is_none() { machine } else { "" }),
                )),
            ];
            for h in 0..HARMONICS {
                let look = v.map_or(UNKNOWN, |v| Look::in_verdict(v, &v.harmonics[h]));
                let rank = v.map_or(Rank::Unknown, |v| v.harmonics[h].rank);
                let code = if rank == Rank::Unknown { "?" } else { rank.code() };
                let doubt = if look.level < 0 || look.sure { "" } else { "?" };
                cells.push(Cell::from(Span::styled(format!("{code}{doubt}"), self.rank_ink(look))));
            }
            let skip = channel.looks.len().saturating_sub(strip);
            let spans: Vec<_> =
                channel.looks.iter().skip(skip).map(|&l| Span::styled(height(l.level), self.rank_ink(l))).collect();
            cells.push(Cell::from(Line::from(spans)));
            let chosen = i == self.row && self.focus == Focus::Rows;
            Row::new(cells).style(if chosen { Style::new().add_modifier(Modifier::REVERSED) } else { Style::new() })
        });
        let widths = [Constraint::Length(longest), Constraint::Length(13)]
            .into_iter()
            .chain([Constraint::Length(4); 5])
            .chain([Constraint::Min(10)]);
        let head = Row::new(["stage · channel", "state", "1x", "2x", "3x", "4x", "5x", "highest rank over time"]);
        let table = Table::new(lines, widths).header(head.style(Style::new().add_modifier(Modifier::BOLD)));
        frame.render_widget(table.block(Block::new().borders(Borders::TOP)), area);
    }

    fn draw_detail(&self, frame: &mut Frame<'_>, area: Rect) {
        let Some(((bench, stage, name), channel)) = self.channels.iter().nth(self.row) else { return };
        let half = usize::from(area.width.saturating_sub(46)) / 2;
        let Some(v) = &channel.last else { return };
        let lines: Vec<_> = (1..)
            .zip(&v.harmonics)
            .map(|(k, h)| {
                let look = Look::in_verdict(v, h);
                let figures = match (finite(h.deviation_percent.value), finite(h.deviation_percent.sigma)) {
                    (Some(d), Some(s)) => format!("{d:+7.2} ± {s:4.2} %"),
                    _ => "      –        ".into(),
                };
                let probability =
                    finite(h.rank_probability).map_or_else(|| "  –".into(), |p| format!("{:3.0}", 100.0 * p));
                let deviation = finite(h.deviation_percent.value).unwrap_or(0.0);
                Line::from(vec![
                    Span::raw(format!("{k}x  ")),
                    Span::styled(format!("{:>7}", h.rank.code()), self.rank_ink(look)),
                    Span::raw(format!("  {figures}  p {probability} % ")),
                    Span::styled(bar(deviation, half), self.rank_ink(look)),
                ])
            })
            .collect();
        let title = format!(" {bench} · {stage} · {name}: deviations, full width ±20 % ");
        frame.render_widget(Paragraph::new(lines).block(Block::new().borders(Borders::TOP).title(title)), area);
    }

    fn draw_alarms(&self, frame: &mut Frame<'_>, area: Rect) {
        let several = benches(&self.status).len() > 1;
        let lines: Vec<_> = faults(&self.status)
            .iter()
            .enumerate()
            .map(|(i, fault)| {
                let chosen = i == self.alarm && self.focus == Focus::Alarms;
                let style = if chosen { Style::new().add_modifier(Modifier::REVERSED) } else { Style::new() };
                Line::styled(in_words(fault, several), style)
            })
            .collect();
        let none = lines.is_empty();
        let body = if none { vec![Line::raw("none")] } else { lines };
        frame.render_widget(Paragraph::new(body).block(Block::new().borders(Borders::TOP).title(" alarms ")), area);
    }
}

fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}

/// The machine state whose code begins with this letter: the past of a row has a letter a window.
fn state_of(letter: u8) -> MachineState {
    let begins = |state: &&MachineState| state.code().as_bytes().first() == Some(&letter);
    MachineState::ALL.iter().find(begins).copied().unwrap_or_default()
}

fn benches(status: &Value) -> &[Value] {
    status["benches"].as_array().map_or(&[], Vec::as_slice)
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
mod tests;
