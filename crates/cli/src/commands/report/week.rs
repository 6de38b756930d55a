//! The parts of a weekly report.

use std::collections::BTreeMap;

use gearwatch_core::bench::Bench;
use gearwatch_core::rank::RankConfig;
use gearwatch_core::verdict::HARMONICS;
use gearwatch_daemon::config::ReportConfig;
use gearwatch_history::time::iso;
use gearwatch_history::{History, Key, STATES, Span};
use gearwatch_report::{Cell, Chart, Lines, Part, Report, Section, Series, Table, Tone, render};

use super::trend::{FEWEST_DAYS, Line, quantile};

pub(super) const DAY_NS: i64 = 86_400_000_000_000;
/// Days in which a trend is sought.
pub(super) const TREND_DAYS: i64 = 28;
const WEEK_DAYS: i64 = 7;
/// Error of the first kind of all statements of a table together.
const ERROR: f64 = 0.05;
/// Events in the table, the newest; the rest is counted.
const MOST_EVENTS: usize = 500;
/// Rows that have a picture.
const MOST_PICTURES: usize = 24;

/// A week that is reported.
pub(super) struct Week<'a> {
    /// By days, of the last four weeks.
    pub(super) history: &'a History,
    /// End (ns since the epoch).
    pub(super) to: i64,
    /// Date of the report (ns since the epoch).
    pub(super) now: i64,
    pub(super) who: &'a ReportConfig,
    /// The benches, where the configuration names them.
    pub(super) benches: &'a [Bench],
}

/// A difference of two means, with half of its interval.
struct Change {
    by: f64,
    half: f64,
}

/// Welch's comparison of daily means; none with less than two days on either side.
fn change(now: &[f64], before: &[f64], p: f64) -> Option<Change> {
    if now.len() < 2 || before.len() < 2 {
        return None;
    }
    let of = |days: &[f64]| {
        let n = days.len() as f64;
        let mean = days.iter().sum::<f64>() / n;
        let variance = days.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
        (mean, variance / n, n - 1.0)
    };
    let ((a, va, fa), (b, vb, fb)) = (of(now), of(before));
    let variance = va + vb;
    let freedom = if variance > 0.0 { variance * variance / (va * va / fa + vb * vb / fb) } else { fa.min(fb) };
    Some(Change { by: a - b, half: quantile(p, freedom) * variance.sqrt() })
}

fn name((bench, stage, channel): &Key) -> String {
    if bench.is_empty() { format!("{stage} at {channel}") } else { format!("{bench}: {stage} at {channel}") }
}

fn percent(part: u64, of: u64) -> String {
    if of == 0 { "–".to_owned() } else { format!("{:.2} %", 100.0 * part as f64 / of as f64) }
}

fn table(caption: &str, head: &[&str], rows: Vec<Vec<Cell>>) -> Part {
    Part::Table(Table { caption: caption.to_owned(), head: head.iter().map(|&h| h.to_owned()).collect(), rows })
}

impl Week<'_> {
    fn from(&self) -> i64 {
        self.to - WEEK_DAYS * DAY_NS
    }

    /// Days of a row between two times.
    fn days<'b>(&self, spans: &'b BTreeMap<i64, Span>, from: i64, to: i64) -> impl Iterator<Item = (i64, &'b Span)> {
        spans.range(from..to).map(|(&at, span)| (at, span))
    }

    fn deviations(&self, spans: &BTreeMap<i64, Span>, h: usize, from: i64, to: i64) -> Vec<f64> {
        let of = |(_, span): (i64, &Span)| span.deviations[h].estimate(0.5).value;
        self.days(spans, from, to).map(of).filter(|x| x.is_finite()).collect()
    }

    /// Windows of the week.
    pub(super) fn windows(&self) -> u64 {
        self.history
            .groups()
            .flat_map(|(_, spans)| self.days(spans, self.from(), self.to))
            .map(|(_, s)| s.windows)
            .sum()
    }

    fn states(&self, spans: &BTreeMap<i64, Span>, from: i64, to: i64) -> [u64; 5] {
        let mut out = [0; 5];
        for (_, span) in self.days(spans, from, to) {
            out.iter_mut().zip(span.states).for_each(|(sum, n)| *sum += n);
        }
        out
    }

    /// The page.
    pub(super) fn page(&self) -> String {
        let mut total = [0; 5];
        for (_, spans) in self.history.groups() {
            total.iter_mut().zip(self.states(spans, self.from(), self.to)).for_each(|(sum, n)| *sum += n);
        }
        let [alarm, deviating, path, ..] = total;
        let open = self.open_alarms();
        let bench = if self.who.bench.is_empty() { String::new() } else { format!(" of {}", self.who.bench) };
        let (tone, words) = match (alarm, deviating + path, open.len()) {
            (0, 0, 0) => (Tone::Good, "No deviation was found, and no alarm is open.".to_owned()),
            (0, d, 0) => (Tone::Warning, format!("{d} windows deviate or show a changed path; no alarm is open.")),
            (a, d, n) => {
                (Tone::Bad, format!("{a} windows in alarm, {d} deviating or with a changed path; {n} alarm(s) open."))
            }
        };
        render(&Report {
            title: format!("Week{bench} from {} to {}", day(self.from()), day(self.to - DAY_NS)),
            verdict: words,
            tone,
            sections: vec![
                self.about(),
                self.changed(),
                self.trends(),
                self.hours(),
                self.availability(),
                Section { heading: "Open alarms".into(), parts: vec![alarms_part(open)] },
                self.events(),
                self.pictures(),
            ],
            appendix: Vec::new(),
            provenance: vec![
                ("gearwatch".into(), env!("CARGO_PKG_VERSION").into()),
                ("command".into(), std::env::args().collect::<Vec<_>>().join(" ")),
            ],
        })
    }

    fn about(&self) -> Section {
        let ReportConfig { customer, author, bench, serial } = self.who;
        let stated = [("Customer", customer), ("Bench", bench), ("Serial number", serial), ("Author", author)];
        let mut rows: Vec<Vec<Cell>> = stated
            .into_iter()
            .filter(|(_, text)| !text.is_empty())
            .map(|(name, text)| vec![name.into(), text.as_str().into()])
            .collect();
        rows.push(vec!["Recorded".into(), format!("{} to {}", iso(self.from()), iso(self.to)).into()]);
        rows.push(vec!["Date of the report".into(), iso(self.now).into()]);
        let mut parts = vec![table("Bench and people", &["what", "stated"], rows)];
        parts.extend(self.benches.iter().map(|bench| Part::Chart(crate::commands::sketch::chart(bench))));
        Section { heading: "About".into(), parts }
    }

    /// Error of the first kind of one statement, where there is one for each row and harmonic.
    fn share(&self) -> f64 {
        ERROR / (self.history.groups().count().max(1) * HARMONICS) as f64
    }

    fn changed(&self) -> Section {
        let before = self.from() - WEEK_DAYS * DAY_NS;
        let (mut rows, mut compared) = (Vec::new(), 0);
        for (key, spans) in self.history.groups() {
            for h in 0..HARMONICS {
                let now = self.deviations(spans, h, self.from(), self.to);
                let Some(change) = change(&now, &self.deviations(spans, h, before, self.from()), self.share()) else {
                    continue;
                };
                compared += 1;
                if change.by.abs() > change.half {
                    let mean = now.iter().sum::<f64>() / now.len() as f64;
                    let by = format!("{:+.2} ± {:.2}", change.by, change.half);
                    rows.push(vec![
                        name(key).into(),
                        format!("{}x", h + 1).into(),
                        format!("{mean:+.2}").into(),
                        Cell::toned(by, Tone::Warning),
                    ]);
                }
            }
        }
        let found = match (compared, rows.len()) {
            (0, _) => "Nothing can be compared yet: at least two days in each week are needed.",
            (_, 0) => "None changed by more than the days scatter.",
            _ => "These changed:",
        };
        let text = format!(
            "Mean deviations of this week's days are compared with those of the week before ({compared} comparisons, confidence 95 % for all together). {found}"
        );
        let mut parts = vec![Part::Text(text)];
        if !rows.is_empty() {
            parts.push(table(
                "Deviations from the baseline (percent)",
                &["where", "harmonic", "this week", "change"],
                rows,
            ));
        }
        let states = self.history.groups().map(|(key, spans)| {
            let (now, then) = (self.states(spans, self.from(), self.to), self.states(spans, before, self.from()));
            let cells = STATES.iter().zip(now.into_iter().zip(then)).map(|(state, (n, was))| {
                let tone = match *state {
                    "alarm" if n > 0 => Tone::Bad,
                    "deviating" | "path_changed" if n > 0 => Tone::Warning,
                    _ => Tone::Plain,
                };
                Cell::toned(format!("{n} ({was})"), tone)
            });
            std::iter::once(name(key).into()).chain(cells).collect()
        });
        parts.push(table(
            "Windows by state; the week before in brackets",
            &["where", "alarm", "deviating", "path changed", "unknown", "normal"],
            states.collect(),
        ));
        Section { heading: "What changed since the week before".into(), parts }
    }

    /// The line through the days of the last four weeks, x in days before `to`.
    fn line(&self, spans: &BTreeMap<i64, Span>, h: usize) -> Option<Line> {
        let points = self.days(spans, self.to - TREND_DAYS * DAY_NS, self.to).map(|(at, span)| {
            // In the middle of its day.
            ((at - self.to + DAY_NS / 2) as f64 / DAY_NS as f64, span.deviations[h].estimate(0.5).value)
        });
        Line::through(&points.filter(|point| point.1.is_finite()).collect::<Vec<_>>())
    }

    fn trends(&self) -> Section {
        let (limit, p) = (RankConfig::default().steps_percent[3], self.share());
        let mut rows = Vec::new();
        let mut short = 0;
        for (key, spans) in self.history.groups() {
            for h in 0..HARMONICS {
                let Some(line) = self.line(spans, h) else {
                    short += 1;
                    continue;
                };
                let slope = format!("{:+.3} ± {:.3}", 7.0 * line.slope, 7.0 * line.half_width(p));
                let beyond = line.at(0.0).abs() >= limit;
                let when = match line.meets(limit.copysign(line.slope), p) {
                    None => "no trend".to_owned(),
                    Some(_) if beyond => format!("beyond {limit} % already"),
                    Some(meeting) if meeting.at <= 0.0 => format!("back within {limit} %"),
                    Some(meeting) => {
                        format!("{:.0} days ({:.0} to {:.0})", meeting.at, meeting.earliest.max(0.0), meeting.latest)
                    }
                };
                let tone = if when == "no trend" { Tone::Plain } else { Tone::Warning };
                rows.push(vec![name(key).into(), format!("{}x", h + 1).into(), slope.into(), Cell::toned(when, tone)]);
            }
        }
        let mut text = format!(
            "Straight lines through the daily means of the last {TREND_DAYS} days, at least {FEWEST_DAYS} of them. Confidence 95 % for all rows together. Time to the limit of \
             rank IV ({limit} %) with its interval, only where the slope is significant; it holds if the line goes on straight. Days are taken as independent of each other."
        );
        if short > 0 {
            text += &format!(" {short} of {} deviations have fewer than {FEWEST_DAYS} days.", short + rows.len());
        }
        let mut parts = vec![Part::Text(text)];
        if !rows.is_empty() {
            let head = ["where", "harmonic", "percentage points a week", "time to the limit"];
            parts.push(table("Deviations from the baseline", &head, rows));
        }
        Section { heading: "Trends".into(), parts }
    }

    fn hours(&self) -> Section {
        let mut rows: Vec<Vec<Cell>> = Vec::new();
        // A log of one bench names none.
        let named = self.history.operating().any(|((bench, _), _)| !bench.is_empty());
        for ((bench, cell), days) in self.history.operating() {
            let secs: f64 = days.range(self.from()..self.to).map(|(_, secs)| secs).sum();
            if secs > 0.0 {
                let cell = if cell.is_empty() { "outside the baseline" } else { cell.as_str() };
                let mut row = vec![cell.into(), format!("{:.2}", secs / 3600.0).into()];
                if named {
                    row.insert(0, bench.as_str().into());
                }
                rows.push(row);
            }
        }
        let text = "Time in which windows of one channel and stage of each bench follow each other without a hole, by the cell of the baseline that judged them.";
        let head: &[&str] = if named { &["bench", "cell", "hours"] } else { &["cell", "hours"] };
        let part = table("Hours of this week", head, rows);
        Section { heading: "Operating hours".into(), parts: vec![Part::Text(text.into()), part] }
    }

    fn availability(&self) -> Section {
        let rows = self.history.groups().map(|(key, spans)| {
            let (mut windows, mut not_ok) = (0, 0);
            for (_, span) in self.days(spans, self.from(), self.to) {
                windows += span.windows;
                not_ok += span.not_ok;
            }
            vec![name(key).into(), windows.to_string().into(), percent(windows - not_ok, windows).into()]
        });
        let part = table("Windows whose instrument was ok", &["where", "windows", "ok"], rows.collect());
        Section { heading: "Instruments".into(), parts: vec![part] }
    }

    fn open_alarms(&self) -> Vec<Vec<Cell>> {
        let open = self.history.alarms().filter(|record| !record.alarm.over);
        open.map(|record| {
            let alarm = &record.alarm;
            let seen = alarm
                .seen
                .as_ref()
                .map_or_else(|| "nobody".to_owned(), |s| format!("{}, {}: {}", s.who, iso(s.t_ns), s.why));
            let tone = if alarm.severity.code() == "critical" { Tone::Bad } else { Tone::Warning };
            let id = if record.bench.is_empty() { alarm.id.clone() } else { format!("{}: {}", record.bench, alarm.id) };
            vec![
                id.into(),
                Cell::toned(alarm.severity.code(), tone),
                iso(alarm.since_ns).into(),
                alarm.evidence.as_ref().map_or_else(|| "–".to_owned(), |e| e.words()).into(),
                if alarm.active { "holds" } else { "latched" }.into(),
                seen.into(),
            ]
        })
        .collect()
    }

    fn events(&self) -> Section {
        let all: Vec<_> = self.history.events.iter().filter(|e| (self.from()..self.to).contains(&e.t_ns)).collect();
        let hidden = all.len().saturating_sub(MOST_EVENTS);
        let rows: Vec<Vec<Cell>> =
            all[hidden..].iter().map(|e| vec![iso(e.t_ns).into(), e.kind.into(), e.text.as_str().into()]).collect();
        let caption = if hidden > 0 { format!("the last {MOST_EVENTS}; {hidden} before") } else { "all".to_owned() };
        let part = if rows.is_empty() {
            Part::Text("None.".into())
        } else {
            table(&caption, &["time (UTC)", "what", "more"], rows)
        };
        Section { heading: "Events".into(), parts: vec![part] }
    }

    fn pictures(&self) -> Section {
        let limit = RankConfig::default().steps_percent[3];
        let mut groups: Vec<_> = self.history.groups().collect();
        let grave = |spans: &BTreeMap<i64, Span>| {
            let [alarm, deviating, path, ..] = self.states(spans, self.from(), self.to);
            std::cmp::Reverse((alarm, deviating + path))
        };
        groups.sort_by_key(|(_, spans)| grave(spans));
        let hidden = groups.len().saturating_sub(MOST_PICTURES);
        let charts = groups.into_iter().take(MOST_PICTURES).filter_map(|(key, spans)| {
            let series = (0..HARMONICS).map(|h| Series {
                name: format!("{}x", h + 1),
                points: self
                    .days(spans, self.to - TREND_DAYS * DAY_NS, self.to)
                    .map(|(at, span)| {
                        ((at - self.to + DAY_NS / 2) as f64 / DAY_NS as f64, span.deviations[h].estimate(0.5).value)
                    })
                    .filter(|point| point.1.is_finite())
                    .collect(),
            });
            let series: Vec<Series> = series.filter(|s: &Series| !s.points.is_empty()).collect();
            (!series.is_empty()).then(|| {
                Part::Chart(Chart::Lines(Lines {
                    caption: format!("{}: daily means; rank IV begins at {limit} %", name(key)),
                    x_label: format!("days before {}", day(self.to)),
                    y_label: "deviation (%)".into(),
                    log_y: false,
                    series,
                    marks: vec![],
                }))
            })
        });
        let mut parts: Vec<Part> = charts.collect();
        if hidden > 0 {
            parts.push(Part::Text(format!("{hidden} rows of lesser gravity have no picture here.")));
        }
        Section { heading: "Daily means".into(), parts }
    }
}

fn alarms_part(rows: Vec<Vec<Cell>>) -> Part {
    if rows.is_empty() {
        return Part::Text("None.".into());
    }
    table(
        "Alarms that hold or that nobody has acknowledged",
        &["where", "severity", "since", "evidence", "state", "seen by"],
        rows,
    )
}

fn day(ns: i64) -> String {
    iso(ns).chars().take(10).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Means 3 and 1, variances of the means 1/3 each, 4 degrees of freedom: half the interval is
    /// 2.776 √(2/3).
    #[test]
    fn analytic_welch_of_two_weeks() {
        let change = change(&[2.0, 3.0, 4.0], &[0.0, 1.0, 2.0], 0.05).expect("three days each");
        assert!((change.by - 2.0).abs() < 1e-12);
        assert!((change.half - 2.776 * (2.0_f64 / 3.0).sqrt()).abs() < 1e-3, "{}", change.half);
        assert!(super::change(&[1.0], &[1.0, 2.0], 0.05).is_none());
    }
}
