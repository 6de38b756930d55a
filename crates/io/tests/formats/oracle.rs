use gearwatch_io::open;

use gearwatch_testkit::files::shared;

/// Each real file opens, or says why not.
#[test]
fn oracle_each_real_file_opens_or_says_why_not() {
    let Some(folder) = shared("data/readers") else { return };
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let mut opened = match open(&path, &gearwatch_io::OpenOptions::default()) {
            Ok(opened) => opened,
            Err(error) => {
                let text = error.to_string();
                assert!(text.contains(&name), "{text}");
                assert!(name.starts_with("LICENSE") || name == "README.md", "{text}");
                continue;
            }
        };
        let (summary, error) = gearwatch_io::summary::Summary::read(&mut opened);
        match error {
            None => assert!(!summary.channels.is_empty(), "{name}"),
            Some(error) => {
                let text = error.to_string();
                let expected = match name.as_str() {
                    "open_area_0.mcap" => "no message at all",
                    // Two columns of integers (seconds and nanoseconds) are their time, which no
                    // one column says.
                    _ if name.ends_with(".csv") => "--sample-rate",
                    _ => panic!("{text}"),
                };
                assert!(text.contains(expected), "{text}");
            }
        }
    }
}
