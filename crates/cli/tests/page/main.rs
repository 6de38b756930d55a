//! The live page in a real browser, against the real service. Skipped with a message where there is
//! no Chromium.

#![expect(clippy::print_stderr, reason = "tests tell what was skipped")]

mod chromium;
mod report;
mod year;

use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{SystemTime, UNIX_EPOCH};

use chromium::Chromium;
use serde_json::json;

struct Service(Child);

impl Service {
    fn start(folder: &Path) -> Self {
        let child = Command::new(env!("CARGO_BIN_EXE_gearwatch"))
            .args(["run", "--config", "service.toml"])
            .current_dir(folder)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        Self(child.expect("the binary runs"))
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a free port").port()
}

const BENCH: &str = include_str!("../../../sim/src/shipped/paper-rig.toml");

fn config(port: u16) -> String {
    let source =
        |more: &str| format!("kind = \"test_signal\"\namplitudes = [1.0, 0.6, 0.4, 0.3, 0.2]\nnoise = 0.02\n{more}");
    format!(
        "format = \"gearwatch-service/1\"\n[service]\npage = \"127.0.0.1:{port}\"\n[[bench]]\nfile = \"bench.toml\"\n\
         alarm = {{ needed = 2, of = 3, clear = 10, latch = true }}\n\
         [bench.learn_from]\n{}[[bench.source]]\n{}[[sink]]\nkind = \"stdout\"\n\
         [[sink]]\nkind = \"mcap_log\"\nfolder = \"log\"\nspectra_secs = 1.0\n\
         raw = {{ keep = \"around_deviations\", level = 3, before_secs = 2.0, after_secs = 2.0, buffer_bytes = 67108864 }}\n",
        source("speed = \"max\"\nduration_secs = 20.0\n"),
        source(&format!(
            "seed = 2\nfirst_sample_unix_ns = {}000000000\nfault = {{ after_secs = 6.0, stage = \"stage1\", percent = [3.0, 6.0, -9.0, 12.0, 20.0] }}\n",
            now_secs()
        ))
    )
}

/// The log is asked for by the time of day.
fn now_secs() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

const LAMP: &str = "document.querySelector('#lamp-machine').dataset.state";

/// A fault sets in: the lamp turns, the strip moves, the spectrum and the nearest states show; an
/// alarm is acknowledged; the service goes, and the page no longer shows green; it returns, and the
/// page heals. No complaint, no request to another host.
#[test]
fn conform_the_page_shows_a_fault_and_heals() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let Some(mut browser) = Chromium::start(folder) else {
        return eprintln!("skipped: there is no chromium on this machine");
    };
    std::fs::write(folder.join("bench.toml"), BENCH).expect("written");
    let port = free_port();
    std::fs::write(folder.join("service.toml"), config(port)).expect("written");
    let service = Service::start(folder);
    let url = format!("http://127.0.0.1:{port}/");
    // A page that is not there yet is asked for again, as a person would.
    while browser.value("document.querySelector('#lamp-machine') !== null") != json!(true) {
        browser.open(&url);
        std::thread::sleep(std::time::Duration::from_millis(300));
    }
    browser.complaints.clear();
    browser.wait("four rows", "document.querySelectorAll('#rows .row').length === 4");
    browser.wait("healthy", &format!("{LAMP} === 'normal'"));
    browser.wait("the fault", &format!("{LAMP} === 'alarm'"));
    browser.wait("ranks", "document.querySelector('#ranks tbody').innerText.includes('IV')");
    browser.wait(
        "a spectrum",
        "!document.querySelector('#spectra').hidden && document.querySelector('#spectrum canvas') !== null",
    );
    browser.wait("nearest states", "document.querySelectorAll('#states li').length > 0");
    browser.wait("the tab says it too", "document.title.startsWith('▲ alarm')");
    browser.wait("indicators", "document.querySelectorAll('#indicators tbody tr:not([hidden])').length >= 5");
    stays_where_it_was_put(&mut browser);
    // The log is read by the page too: steps, and the alarm among the events.
    browser.value("document.querySelector('#history').open = true; 0");
    browser
        .wait("steps from the log", "/^[1-9]\\d* steps of/.test(document.querySelector('#history-state').innerText)");
    browser.wait(
        "the alarm in the log",
        "document.querySelector('#history-events').innerText.includes('critical stage1@acc_1')",
    );
    shows_spectra_and_raw_data_of_then(&mut browser);
    // An alarm that grows must be acknowledged again: first all are as grave as they become.
    let grave = "[...document.querySelectorAll('#alarms tbody tr')].filter((r) => r.innerText.includes('critical')).length === 2";
    browser.wait("two grave alarms", grave);
    // Both channels of the stage are one entry, with the harmonic, its value and the limit.
    browser.wait("one group", "document.querySelectorAll('.alarm-group').length === 1");
    let evidence = browser.value("document.querySelector('#alarms tbody tr').innerText");
    let evidence = evidence.as_str().unwrap_or_default();
    assert!(evidence.contains("rank V") && evidence.contains("± 10 %") && evidence.contains("Hz"), "{evidence}");
    browser.value("document.querySelector('#alarms button.acknowledge').click()");
    // Without a name and a reason it stays unseen.
    browser.value("document.querySelector('#acknowledge .send').click()");
    browser
        .wait("what is missing", "document.querySelector('#acknowledge [role=status]').innerText.includes('needed')");
    browser.value(
        "{ const of = (name) => document.querySelector(`#acknowledge input[name=${name}]`); \
           of('who').value = 'shift A'; of('why').value = 'wheel is being changed'; \
           document.querySelector('#acknowledge .send').click(); 0 }",
    );
    browser.wait(
        "acknowledged",
        "[...document.querySelectorAll('#alarms .seen')].every((c) => /shift A, \\d{4}-\\d\\d-\\d\\dT.*: wheel is being changed/.test(c.innerText))",
    );
    // The keyboard moves between rows.
    browser.value("document.querySelector('#rows').dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowDown', bubbles: true }))");
    browser.wait(
        "another row",
        "document.querySelector('#rows .row[aria-selected=true]') !== document.querySelector('#rows .row')",
    );
    assert_eq!(browser.complaints, Vec::<String>::new());

    drop(service);
    browser.wait("not green without a service", &format!("{LAMP} === 'unknown'"));
    let _again = Service::start(folder);
    browser.wait("healed", "document.querySelector('#lamp-link').dataset.state === 'ok'");
    browser.wait("judging again", &format!("{LAMP} === 'normal' || {LAMP} === 'alarm'"));
    assert_eq!(browser.complaints, Vec::<String>::new());
    let foreign: Vec<_> = browser.requests.iter().filter(|r| r.starts_with("http") && !r.starts_with(&url)).collect();
    assert!(foreign.is_empty(), "{foreign:?}");
}

/// Two benches, of which the one that is not selected has a fault: lamp, title, buttons and rows
/// name it, and the speed is that of the selected one.
#[test]
fn regress_the_lamps_speak_of_all_benches() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let Some(mut browser) = Chromium::start(folder) else {
        return eprintln!("skipped: there is no chromium on this machine");
    };
    let port = free_port();
    let source =
        |more: &str| format!("kind = \"test_signal\"\namplitudes = [1.0, 0.6, 0.4, 0.3, 0.2]\nnoise = 0.02\n{more}");
    let mut config = format!("format = \"gearwatch-service/1\"\n[service]\npage = \"127.0.0.1:{port}\"\n");
    for (name, fault) in [
        ("east", ""),
        ("west", "fault = { after_secs = 2.0, stage = \"stage1\", percent = [3.0, 6.0, -9.0, 12.0, 20.0] }\n"),
    ] {
        let bench = BENCH.replacen("name = \"paper-rig\"", &format!("name = \"{name}\""), 1);
        assert!(bench.contains(&format!("name = \"{name}\"")), "the shipped bench has another name");
        std::fs::write(folder.join(format!("{name}.toml")), bench).expect("written");
        config += &format!(
            "[[bench]]\nfile = \"{name}.toml\"\nalarm = {{ needed = 2, of = 3 }}\n[bench.learn_from]\n{}[[bench.source]]\n{}",
            source("speed = \"max\"\nduration_secs = 20.0\n"),
            source(&format!("seed = 2\n{fault}")),
        );
    }
    std::fs::write(folder.join("service.toml"), config + "[[sink]]\nkind = \"stdout\"\n").expect("written");
    let _service = Service::start(folder);
    let url = format!("http://127.0.0.1:{port}/");
    while browser.value("document.querySelector('#lamp-machine') !== null") != json!(true) {
        browser.open(&url);
        std::thread::sleep(std::time::Duration::from_millis(300));
    }
    browser.complaints.clear();
    browser.wait("four rows of each", "document.querySelectorAll('#rows .row').length === 8");
    let click = |what: &str| format!("{{ {what}.click(); 0 }}");
    browser.value(&click("[...document.querySelectorAll('#rows .row')].find((r) => r.innerText.includes('east'))"));
    browser.wait("the healthy bench is selected", "document.querySelector('#bench').innerText === 'east'");
    browser.wait("the other one's fault", &format!("{LAMP} === 'alarm'"));
    browser.wait("its name", "document.querySelector('#lamp-machine').innerText.includes('alarm: west')");
    browser.wait("the title", "document.title.startsWith('▲ alarm 1/2')");
    browser.wait("the healthy bench is selected still", "document.querySelector('#bench').innerText === 'east'");
    let lamps =
        "[...document.querySelectorAll('#benches button')].map((b) => `${b.dataset.bench} ${b.dataset.state}`).join()";
    browser.wait("a button for each, the gravest first", &format!("{lamps} === 'west alarm,east normal'"));
    // Each row says whose it is, in what is seen.
    let named = "[...document.querySelectorAll('#rows .row')].every((r) => /^(east|west) · stage/.test(r.innerText))";
    browser.wait("rows with their bench", named);
    browser.value(&click("document.querySelector('#benches button[data-bench=west]')"));
    browser.wait(
        "rows of one bench",
        "[...document.querySelectorAll('#rows .row:not([hidden])')].map((r) => r.innerText.slice(0, 4)).join() === 'west,west,west,west'",
    );
    assert_eq!(browser.complaints, Vec::<String>::new());
}

/// Spectra of the log, one of them as a curve and all as a waterfall, their band as the normal one;
/// raw data around the deviation as a picture and as a file.
fn shows_spectra_and_raw_data_of_then(browser: &mut Chromium) {
    browser.value("document.querySelector('#then').open = true; 0");
    browser.wait("spectra of then", "/^[1-9]\\d* spectra from/.test(document.querySelector('#then-state').innerText)");
    browser.wait("its curve", "document.querySelector('#then-spectrum canvas') !== null");
    browser.wait("five of them", "document.querySelector('#then-slider').max >= 5");
    browser.value(
        "{ const s = document.querySelector('#then-slider'); s.value = '0'; s.dispatchEvent(new Event('input')); 0 }",
    );
    browser.wait("the first", "document.querySelector('#then-slider').getAttribute('aria-valuetext') === document.querySelector('#then-time').innerText");
    browser.value("document.querySelector('#then-normal').click(); 0");
    browser.wait(
        "a normal spectrum",
        "/^Normal: \\d+ spectra from/.test(document.querySelector('#then-normal').innerText)",
    );
    browser.wait("raw data", "!document.querySelector('#raw-show').disabled");
    browser.value("document.querySelector('#raw-show').click(); 0");
    browser.wait(
        "its curve",
        "document.querySelector('#raw-wave canvas') !== null && !document.querySelector('#raw-listen').disabled",
    );
    browser.value("window.saved = []; document.querySelector('#raw-mcap').click(); 0");
    browser.wait("a recording", "saved.length === 1 && /^gearwatch-raw-\\d{8}T\\d{6}Z\\.mcap$/.test(saved[0])");
}

/// What somebody chose stays while windows come in: the part of the time that is shown, the words
/// that are sought. What is shown can be taken along.
fn stays_where_it_was_put(browser: &mut Chromium) {
    browser.value("import('/assets/trend.js').then((m) => { window.time = m.time })");
    browser.wait("the module", "window.time !== undefined");
    let windows = "Number(/window (\\d+)/.exec(document.querySelector('#window').innerText)[1])";
    browser.value(
        "time.set([time.plots.values().next().value.shown()[0], time.plots.values().next().value.shown()[0] + 4])",
    );
    let put = browser.value("JSON.stringify(time.plots.values().next().value.shown())");
    let before = browser.value(windows).as_u64().expect("a window");
    browser.wait("three more windows", &format!("{windows} >= {}", before + 3));
    assert_eq!(browser.value("JSON.stringify(time.plots.values().next().value.shown())"), put, "the zoom has moved");
    let names = browser.value("window.saved = []; HTMLAnchorElement.prototype.click = function () { if (this.download) saved.push(this.download) }; [...document.querySelectorAll('[aria-label=\"CSV Deviations: download the numbers\"], [aria-label=\"PNG Deviations: download the picture\"]')].forEach((b) => b.click()); saved.length");
    assert!(names == json!(1) || names == json!(2), "the CSV at once, the picture when it is ready: {names}");
    browser.wait(
        "both files",
        "saved.length === 2 && saved.every((n) => /^gearwatch-Deviations-.*\\.(csv|png)$/.test(n))",
    );
    let over = "document.querySelector('#deviations .u-over')";
    browser.value(&format!("{over}.dispatchEvent(new MouseEvent('dblclick', {{ bubbles: true }})); 0"));
    browser.wait("all again", "time.range === null");
    let shown = "document.querySelectorAll('#rows .row:not([hidden])').length";
    let seek = |words: &str| {
        format!(
            "{{ const s = document.querySelector('#search'); s.value = '{words}'; s.dispatchEvent(new Event('input')); 0 }}"
        )
    };
    browser.value(&seek("stage1 acc_2"));
    browser.wait("one row is found", &format!("{shown} === 1"));
    browser.value(&seek(""));
    browser.wait("all rows", &format!("{shown} === 4"));
    // The worst first: both channels of the stage that has the fault.
    browser.wait(
        "the worst first",
        "[...document.querySelectorAll('#rows .row')].slice(0, 2).every((r) => r.innerText.includes('stage1'))",
    );
}

/// An hour of eight channels and two stages, and what comes in at twenty times the usual pace: the
/// page shows it all from its first moment on. Prints when it was first painted and how long its
/// tasks were; what must hold on every machine is checked.
#[test]
#[ignore = "takes four minutes: just page"]
fn conform_an_hour_of_eight_channels_is_in_view() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let Some(mut browser) = Chromium::start(folder) else {
        return eprintln!("skipped: there is no chromium on this machine");
    };
    let sensors: String = (3..=8).map(|n| format!("\n[[sensor]]\nname = \"acc_{n}\"\nshaft = \"input\"\n")).collect();
    std::fs::write(folder.join("bench.toml"), format!("{BENCH}{sensors}")).expect("written");
    let port = free_port();
    let config = format!(
        "format = \"gearwatch-service/1\"\n[service]\npage = \"127.0.0.1:{port}\"\n[[bench]]\nfile = \"bench.toml\"\n\
         [[bench.source]]\nkind = \"test_signal\"\namplitudes = [1.0, 0.6, 0.4, 0.3, 0.2]\nnoise = 0.02\nspeed = 20.0\n\
         [[sink]]\nkind = \"stdout\"\n"
    );
    std::fs::write(folder.join("service.toml"), config).expect("written");
    let _service = Service::start(folder);
    std::thread::sleep(std::time::Duration::from_secs(190));
    browser.before_each_page("window.tasks = []; new PerformanceObserver((l) => tasks.push(...l.getEntries().map((e) => e.duration))).observe({ type: 'longtask' })");
    browser.open(&format!("http://127.0.0.1:{port}/"));
    browser.wait("sixteen rows", "document.querySelectorAll('#rows .row').length === 16");
    browser.value("import('/assets/state.js').then((m) => { window.state = m })");
    browser.wait("an hour", "window.state && [...state.rows.values()].every((r) => r.past.length === 7200)");
    let painted = browser.value("performance.getEntriesByName('first-contentful-paint')[0].startTime");
    let opening = browser.value("tasks.splice(0).map(Math.round).join(' ')");
    browser.value("[...document.querySelectorAll('#span button')].at(-1).click()");
    std::thread::sleep(std::time::Duration::from_secs(20));
    let watching = browser.value("tasks.map(Math.round).join(' ')");
    eprintln!(
        "first contentful paint after {painted} ms; tasks over 50 ms: opening [{opening}], 20 s of watching at 20 times the pace [{watching}] ms"
    );
    assert_eq!(browser.complaints, Vec::<String>::new());
}
