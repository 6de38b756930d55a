//! A report in a real browser.

use std::process::Command;

use serde_json::json;

use super::chromium::Chromium;

/// Its curves can be zoomed into and read off, by nothing but what is in the file; its policy
/// refuses nothing of that.
#[test]
fn conform_curves_of_a_report_tell_their_values() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let Some(mut browser) = Chromium::start(folder) else {
        return eprintln!("skipped: there is no chromium on this machine");
    };
    let done = Command::new(env!("CARGO_BIN_EXE_gearwatch"))
        .args(["simulate", "single-pair", "--duration", "2", "--plot", "out.html"])
        .current_dir(folder)
        .output()
        .expect("the binary runs");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    browser.before_each_page(
        "window.refused = []; document.addEventListener('securitypolicyviolation', (e) => refused.push(e.violatedDirective))",
    );
    browser.open(&format!("file://{}", folder.join("out.html").display()));
    browser.wait("a button for each picture", "document.querySelectorAll('figure button').length === 3");
    browser.value("document.querySelectorAll('figure button').forEach((b) => b.click()); 0");
    browser.wait("curves", "document.querySelectorAll('figure.open .u-over').length === 3");
    let values = "[...document.querySelector('figure .u-legend').querySelectorAll('.u-value')].map((v) => v.innerText)";
    assert_eq!(browser.value(&format!("{values}.every((v) => v === '--')")), json!(true), "nothing is pointed at");
    browser.value(
        "{ const over = document.querySelector('figure .u-over'); const { left, top } = over.getBoundingClientRect(); \
           for (const kind of ['mouseenter', 'mousemove']) over.dispatchEvent(new MouseEvent(kind, { clientX: left + 100, clientY: top + 100, movementX: 1, bubbles: true })); 0 }",
    );
    browser.wait("values", &format!("{values}.every((v) => /\\d/.test(v))"));
    browser.value("document.querySelector('figure button').click(); 0");
    browser.wait("the drawing again", "document.querySelectorAll('figure.open').length === 2");
    assert_eq!(browser.value("refused"), json!([]));
    assert_eq!(browser.complaints, Vec::<String>::new());
    let foreign: Vec<_> = browser.requests.iter().filter(|r| !r.starts_with("file://")).collect();
    assert!(foreign.is_empty(), "{foreign:?}");
}
