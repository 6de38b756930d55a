//! Where a service answers that nobody has named: the usual socket, what the configurations of
//! running services name, the usual page.

use std::fmt;
use std::path::{Path, PathBuf};

use gearwatch_daemon::config::Config;

/// Where a service may answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Endpoint {
    Socket(PathBuf),
    Page(String),
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Socket(path) => path.display().fmt(f),
            Self::Page(url) => url.fmt(f),
        }
    }
}

/// All places, the likeliest first.
pub fn places() -> Vec<Endpoint> {
    let mut out = vec![Endpoint::Socket(gearwatch_daemon::status::USUAL_PATH.into())];
    for (arguments, folder) in running() {
        for place in named(&arguments, &folder) {
            if !out.contains(&place) {
                out.push(place);
            }
        }
    }
    let usual = Config::built_in().ok().and_then(|config| config.service.page);
    let page = usual.map(|address| Endpoint::Page(format!("http://{address}")));
    out.extend(page.filter(|page| !out.contains(page)));
    out
}

/// Arguments and working folder of the services that run on this machine, as far as this user may
/// see them.
fn running() -> Vec<(Vec<String>, PathBuf)> {
    let Ok(processes) = std::fs::read_dir("/proc") else { return Vec::new() };
    let of = |path: &Path| {
        let command = std::fs::read(path.join("cmdline")).ok()?;
        let arguments: Vec<String> = command
            .split(|&byte| byte == 0)
            .filter(|word| !word.is_empty())
            .map(|word| String::from_utf8_lossy(word).into_owned())
            .collect();
        let program = Path::new(arguments.first()?).file_name()?.to_str()?;
        program.starts_with("gearwatch").then_some(())?;
        Some((arguments, std::fs::read_link(path.join("cwd")).ok()?))
    };
    processes.flatten().filter_map(|process| of(&process.path())).collect()
}

/// Where a service with these arguments answers; nothing where they are not those of a service.
fn named(arguments: &[String], folder: &Path) -> Vec<Endpoint> {
    let mut words = arguments.iter().skip(1);
    if !words.any(|word| word == "run") {
        return Vec::new();
    }
    let file = words
        .clone()
        .zip(words.clone().skip(1))
        .find_map(|(key, value)| matches!(key.as_str(), "--config" | "-c").then(|| value.clone()));
    let file = file.or_else(|| words.find_map(|word| word.strip_prefix("--config=").map(str::to_owned)));
    let config = match file {
        Some(file) => Config::read(&folder.join(file)),
        None => Config::built_in(),
    };
    let Ok(config) = config else { return Vec::new() };
    let socket = config.service.status_socket.as_ref().map(|path| Endpoint::Socket(config.folder.join(path)));
    let scheme = if config.service.page_tls.is_some() { "https" } else { "http" };
    let page = config.service.page.map(|address| Endpoint::Page(format!("{scheme}://{address}")));
    socket.into_iter().chain(page).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<String> {
        text.split(' ').map(str::to_owned).collect()
    }

    #[test]
    fn conform_what_a_running_service_was_told_says_where_it_answers() {
        let folder = tempfile::tempdir().expect("a folder");
        let text = "format = \"gearwatch-service/1\"\n[service]\npage = \"127.0.0.1:9000\"\nstatus_socket = \"s.sock\"\n\
                    [[bench]]\n[[bench.source]]\nkind = \"simulator\"\n";
        std::fs::write(folder.path().join("bench.toml"), text).expect("written");
        let expected =
            [Endpoint::Socket(folder.path().join("s.sock")), Endpoint::Page("http://127.0.0.1:9000".to_owned())];
        for command in [
            "gearwatch run --config bench.toml",
            "/usr/bin/gearwatch run -c bench.toml",
            "gearwatch run --config=bench.toml",
        ] {
            assert_eq!(named(&words(command), folder.path()), expected, "{command}");
        }
        assert_eq!(named(&words("gearwatch run"), folder.path()), [Endpoint::Page("http://127.0.0.1:8650".to_owned())]);
        for other in ["gearwatch top", "gearwatch run --config missing.toml", "gearwatch status"] {
            assert_eq!(named(&words(other), folder.path()), [], "{other}");
        }
    }
}
