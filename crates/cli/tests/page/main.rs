//! The live page in a real browser, against the real service. Skipped with a message where there is no Chromium.

#![expect(clippy::print_stderr, reason = "tests tell what was skipped")]

mod chromium;

use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};

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

fn config(port: u16) -> String {
    let source =
        |more: &str| format!("kind = \"test_signal\"\namplitudes = [1.0, 0.6, 0.4, 0.3, 0.2]\nnoise = 0.02\n{more}");
    format!(
        "format = \"gearwatch-service/1\"\n[service]\npage = \"127.0.0.1:{port}\"\n[[bench]]\nfile = \"bench.toml\"\n\
         alarm = {{ needed = 2, of = 3, clear = 10, latch = true }}\n\
         [bench.learn_from]\n{}[[bench.source]]\n{}[[sink]]\nkind = \"stdout\"\n",
        source("speed = \"max\"\nduration_secs = 20.0\n"),
        source("seed = 2\nfault = { after_secs = 6.0, stage = \"stage1\", percent = [3.0, 6.0, -9.0, 12.0, 20.0] }\n")
    )
}

const LAMP: &str = "document.querySelector('#lamp-machine').dataset.state";

/// A fault sets in: the lamp turns, the strip moves, the spectrum and the nearest states show; an alarm is acknowledged; the service
/// goes, and the page no longer shows green; it returns, and the page heals. No complaint, no request to another host.
#[test]
fn conform_the_page_shows_a_fault_and_heals() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let Some(mut browser) = Chromium::start(folder) else {
        return eprintln!("skipped: there is no chromium on this machine");
    };
    std::fs::write(folder.join("bench.toml"), include_str!("../../../sim/src/shipped/paper-rig.toml"))
        .expect("written");
    let port = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a free port").port();
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
    // An alarm that grows must be acknowledged again: first all are as grave as they become.
    let grave = "[...document.querySelectorAll('#alarms tbody tr')].filter((r) => r.innerText.includes('critical')).length === 2";
    browser.wait("two grave alarms", grave);
    browser.value("document.querySelector('#alarms button:not(:disabled)').click()");
    browser.wait(
        "acknowledged",
        "[...document.querySelectorAll('#alarms button')].some((b) => b.innerText === 'Acknowledged')",
    );
    // The keyboard moves between rows.
    browser.value("document.querySelector('#rows').dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowDown', bubbles: true }))");
    browser
        .wait("the second row", "document.querySelectorAll('#rows .row')[1].getAttribute('aria-selected') === 'true'");
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
