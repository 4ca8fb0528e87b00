//! Settings are shown, changed, saved to a file, loaded from it, and compared.

use std::process::ExitCode;

use slitrange_device::settings::{Setting, Settings};
use slitrange_tool::pc::Pc;

use super::stand_in::{StandIn, Trouble};

fn sensor(seed: u64) -> StandIn {
    StandIn::new(seed, Trouble::default())
}

/// `slitrange settings` of a sensor.
fn settings(sensor: &StandIn, arguments: &[&str]) -> (Result<ExitCode, String>, String) {
    let port = sensor.port();
    let all = [&["--port", &port], arguments].concat();
    sensor.command("settings", &all, "")
}

#[test]
fn every_setting_is_shown_with_its_values_and_help() {
    let sensor = sensor(1);
    sensor.state().type_line("rows 64");
    let (result, output) = settings(&sensor, &[]);
    result.expect("settings");
    let longest = output.lines().map(|line| line.chars().count()).max();
    assert!(longest <= Some(100), "{longest:?}");
    // A line that begins with blanks goes on with the setting above it.
    let lines: Vec<&str> = output.lines().collect();
    for &setting in Setting::ALL {
        let name = format!("{}  ", setting.name());
        let line = lines.iter().position(|line| line.starts_with(&name));
        let line = line.unwrap_or_else(|| panic!("{setting:?}"));
        let further = lines[line + 1..].iter();
        let further = further.take_while(|line| line.starts_with(' '));
        // The third column begins where it begins in the first line.
        let begin = lines[1].find("what it sets").expect("a heading");
        let of = |line: &&&str| line.get(begin..).unwrap_or_default().trim_end().to_owned();
        let all = [&lines[line]].into_iter().chain(further);
        let told = all.map(|line| of(&line)).collect::<Vec<_>>().join(" ");
        let end = match setting {
            Setting::Rows => "; factory 16",
            _ => "",
        };
        let expected = format!("{}: {}{end}", setting.help(), setting.form());
        assert_eq!(told.trim_end(), expected);
        let is_changed = lines[line].contains(" *  ");
        assert_eq!(is_changed, setting == Setting::Rows, "{told}");
    }
}

#[test]
fn a_value_is_changed_and_stays() {
    let sensor = sensor(2);
    for (words, get, line) in [
        (&["rows", "64"] as &[&str], "64", "rows 64 (it was 16)\n"),
        (
            &["exposure", "limit", "2000"],
            "2000",
            "exposure limit 2000 (it was 5600)\n",
        ),
        (
            &["black", "fixed", "300"],
            "fixed 300",
            "black fixed 300 (it was shielded)\n",
        ),
        // The session itself switches the stream off.
        (&["stream", "off"], "off", "stream off (it was on)\n"),
        (&["echo", "on"], "on", "echo on (it was off)\n"),
    ] {
        let (result, output) = settings(&sensor, &[&["set"], words].concat());
        result.expect("set");
        assert_eq!(output, line);
        let name = &words[..if words[1] == "limit" { 2 } else { 1 }];
        let (result, output) = settings(&sensor, &[&["get"], name].concat());
        result.expect("a value");
        assert_eq!(output.trim_end(), get);
    }
    let now = sensor.state().settings();
    assert_eq!((now.rows, now.stream, now.echo), (64, false, true));
}

#[test]
fn a_wrong_value_is_an_error_that_names_the_right_ones() {
    let sensor = sensor(3);
    let mut errors = String::new();
    for words in [
        &["set", "rows", "65"] as &[&str],
        &["set", "rows"],
        &["set", "rose", "3"],
        &["set", "black", "fixed"],
        &["set", "save"],
        &["get", "exposure", "limits"],
    ] {
        let error = settings(&sensor, words).0.expect_err("wrong");
        // The list of all settings, which grows, follows.
        let error = error
            .split(" The settings are: ")
            .next()
            .unwrap_or_default();
        errors += &format!("{}: {error}\n", words.join(" "));
    }
    insta::assert_snapshot!(errors);
    assert_eq!(sensor.state().settings(), Settings::default());
}

/// It would no longer answer the tool.
#[test]
fn a_sensor_stays_alone_on_its_line() {
    let sensor = sensor(7);
    let reason = "the tool talks to a sensor that is alone on its line: `address 0`, and not `format modbus`";
    for words in ["address 5", "address 247", "format modbus"] {
        let set: Vec<&str> = ["set"].into_iter().chain(words.split(' ')).collect();
        let error = settings(&sensor, &set).0.expect_err("refused");
        assert_eq!(error, format!("`{words}` is not set here: {reason}"));
        let path = sensor.path("alone.toml");
        let (name, value) = words.split_once(' ').expect("a value");
        std::fs::write(&path, format!("rows = 4\n{name} = \"{value}\"\n")).expect("written");
        let load = ["load", path.to_str().expect("text")];
        let error = settings(&sensor, &load).0.expect_err("refused");
        assert_eq!(error, format!("`{words}` is not set here: {reason}"));
    }
    // Time goes on as soon as anything is sent.
    assert_eq!(sensor.now(), std::time::Duration::ZERO);
    assert_eq!(sensor.state().settings(), Settings::default());
    let (result, output) = settings(&sensor, &["set", "address", "0"]);
    result.expect("as before");
    assert_eq!(output, "address 0 (as before)\n");
}

#[test]
fn a_file_moves_settings_from_one_sensor_to_another() {
    let (first, second) = (sensor(4), sensor(5));
    first.state().type_line("rows 32");
    first.state().type_line("estimator phase-table");
    let path = first.path("bench.toml");
    let file = path.to_str().expect("text");
    settings(&first, &["save", file]).0.expect("saved");
    println!("{}", std::fs::read_to_string(&path).expect("a file"));

    let (differ, output) = settings(&second, &["compare", file]);
    assert_eq!(differ, Ok(ExitCode::from(1)));
    assert!(output.contains(&format!("rows: 16 at {}, 32 in {file}\n", second.port())));
    let (result, output) = settings(&second, &["load", file, "--flash"]);
    result.expect("loaded");
    assert!(output.starts_with("rows: 16 -> 32\n"));
    assert!(output.contains("estimator: adaptive -> phase-table\n2 settings changed, "));
    assert!(output.ends_with("saved: they are kept over a power cycle\n"));
    assert_eq!(
        settings(&second, &["compare", file]).0,
        Ok(ExitCode::SUCCESS)
    );
    assert!(
        settings(&second, &["load", file])
            .1
            .starts_with("0 settings changed, ")
    );
    second.state().type_line("rows 16");
    let (_, output) = settings(&second, &["load", file]);
    assert!(
        output.contains("rows: 16 -> 32\n1 setting changed, "),
        "{output}"
    );
    // They are in flash: a start keeps them.
    assert_eq!(second.state().saved_rows(), Some(32));
    assert_eq!(second.state().settings(), first.state().settings());
}

#[test]
fn a_file_with_a_wrong_line_changes_nothing() {
    let sensor = sensor(6);
    let path = sensor.path("wrong.toml");
    std::fs::write(&path, "mean = \"plain\"\nrows = 100\n").expect("written");
    let error = settings(&sensor, &["load", path.to_str().expect("text")]).0;
    let error = error.expect_err("100 rows");
    assert!(
        error.contains("`rows 100`: out of range, expected rows 1..64"),
        "{error}"
    );
    assert_eq!(sensor.state().settings(), Settings::default());
}
