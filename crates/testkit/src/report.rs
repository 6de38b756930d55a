//! Reports as files that are handed on.

/// What makes a browser load something. The name of SVG's vocabulary, and where the drawing library
/// comes from, are names alone.
const LOADING: [&str; 7] = ["src=", "href=", "url(", "@import", "fetch(", "XMLHttpRequest", "import("];
const NAMES: [&str; 2] = ["http://www.w3.org/2000/svg", "/*! https://github.com/leeoniya/uPlot"];

/// What a report would load, or could; empty for one that needs no network, and may not use any.
pub fn loads(page: &str) -> Vec<String> {
    let mut rest = page.to_owned();
    NAMES.iter().for_each(|name| rest = rest.replace(name, ""));
    let mut out: Vec<String> = LOADING.iter().filter(|how| rest.contains(**how)).map(|how| (*how).to_owned()).collect();
    let addresses = rest.split_whitespace().filter(|word| word.contains("://"));
    out.extend(addresses.map(|word| word.chars().take(80).collect()));
    if !page.contains("http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; ") {
        out.push("no policy against it".to_owned());
    }
    out
}
