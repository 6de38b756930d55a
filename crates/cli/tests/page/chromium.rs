//! Just enough of the DevTools protocol to look at a page: JSON objects, each ended by a NUL, over
//! two pipes.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

const NAMES: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

pub struct Chromium {
    browser: Child,
    to: File,
    from: BufReader<File>,
    next: u64,
    session: String,
    /// Uncaught exceptions and console messages of level `error`.
    pub complaints: Vec<String>,
    /// Addresses that were asked for.
    pub requests: Vec<String>,
}

impl Chromium {
    /// Starts a browser with an empty page; `None` where there is no browser.
    pub fn start(folder: &Path) -> Option<Self> {
        let found = |name: &&str| Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success());
        let name = NAMES.iter().find(|name| found(name))?;
        for pipe in ["to", "from"] {
            let made = Command::new("mkfifo").arg(folder.join(pipe)).status().expect("mkfifo");
            assert!(made.success());
        }
        let script = format!(
            "exec {name} --headless=new --no-sandbox --disable-gpu --no-first-run --disable-background-networking \
             --disable-component-update --disable-sync --user-data-dir=profile --window-size=1400,1000 \
             --remote-debugging-pipe 3<to 4>from about:blank"
        );
        let browser = Command::new("sh")
            .args(["-c", &script])
            .current_dir(folder)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("a shell");
        // In the order in which the shell opens them: either end waits for the other.
        let to = OpenOptions::new().write(true).open(folder.join("to")).expect("a pipe");
        let from = BufReader::new(File::open(folder.join("from")).expect("a pipe"));
        let (complaints, requests) = (Vec::new(), Vec::new());
        let mut it = Self { browser, to, from, next: 0, session: String::new(), complaints, requests };
        let target = it.call("Target.createTarget", json!({ "url": "about:blank" }))["targetId"].clone();
        let attached = it.call("Target.attachToTarget", json!({ "targetId": target, "flatten": true }));
        it.session = attached["sessionId"].as_str().expect("a session").to_owned();
        for domain in ["Runtime.enable", "Network.enable", "Page.enable"] {
            it.call(domain, json!({}));
        }
        Some(it)
    }

    /// Opens an address.
    pub fn open(&mut self, url: &str) {
        self.call("Page.navigate", json!({ "url": url }));
    }

    /// A script that runs before those of each page.
    pub fn before_each_page(&mut self, script: &str) {
        self.call("Page.addScriptToEvaluateOnNewDocument", json!({ "source": script }));
    }

    /// The value of an expression on the page.
    pub fn value(&mut self, expression: &str) -> Value {
        let result = self.call("Runtime.evaluate", json!({ "expression": expression, "returnByValue": true }));
        result["result"]["value"].clone()
    }

    /// Waits until an expression is true.
    pub fn wait(&mut self, what: &str, expression: &str) {
        let until = Instant::now() + Duration::from_secs(60);
        while self.value(expression) != json!(true) {
            assert!(Instant::now() < until, "{what}: {expression} did not become true; the page shows {}", self.text());
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// The page's text.
    pub fn text(&mut self) -> Value {
        self.value("document.body.innerText")
    }

    fn call(&mut self, method: &str, params: Value) -> Value {
        self.next += 1;
        let mut message = json!({ "id": self.next, "method": method, "params": params });
        if !self.session.is_empty() {
            message["sessionId"] = json!(self.session);
        }
        self.to.write_all(format!("{message}\0").as_bytes()).expect("the browser listens");
        loop {
            let mut bytes = Vec::new();
            self.from.read_until(0, &mut bytes).expect("the browser answers");
            assert!(!bytes.is_empty(), "the browser has gone");
            let heard: Value = serde_json::from_slice(&bytes[..bytes.len() - 1]).expect("JSON");
            if heard["id"] == json!(self.next) {
                assert!(heard.get("error").is_none(), "{method}: {heard}");
                return heard["result"].clone();
            }
            self.note(&heard);
        }
    }

    fn note(&mut self, event: &Value) {
        match event["method"].as_str() {
            Some("Runtime.exceptionThrown") => self.complaints.push(event["params"].to_string()),
            Some("Runtime.consoleAPICalled") if event["params"]["type"] == "error" => {
                self.complaints.push(event["params"]["args"].to_string());
            }
            Some("Network.requestWillBeSent") => {
                self.requests.extend(event["params"]["request"]["url"].as_str().map(str::to_owned));
            }
            _ => {}
        }
    }
}

impl Drop for Chromium {
    fn drop(&mut self) {
        let _ = self.browser.kill();
        let _ = self.browser.wait();
    }
}
