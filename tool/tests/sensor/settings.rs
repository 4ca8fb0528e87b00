//! Settings are shown, changed, saved, written to a file, taken from it, and compared.

use super::stand_in::StandIn;
use crate::command::*;

fn settings(sensor: &StandIn, line: &str) -> String {
    sensor.done(&format!("settings --port PORT {line}"))
}

fn refused(sensor: &StandIn, line: &str) -> String {
    sensor.refused(&format!("settings --port PORT {line}"))
}

#[test]
fn every_setting_is_shown_with_its_values_and_help() {
    let sensor = StandIn::new(1);
    sensor.state().type_line("rows 64");
    let output = settings(&sensor, "");
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
    let sensor = StandIn::new(2);
    for (name, value, before) in [
        ("rows", "64", "16"),
        ("exposure limit", "2000", "5600"),
        ("black", "fixed 300", "shielded"),
        // The session itself switches the stream off.
        ("stream", "off", "on"),
        ("echo", "on", "off"),
    ] {
        let output = settings(&sensor, &format!("set {name} {value}"));
        let hint = match name {
            "stream" | "echo" => "",
            _ => "in RAM only: --save keeps it over a power cycle\n",
        };
        assert_eq!(output, format!("{name} {value} (it was {before})\n{hint}"));
        assert_eq!(settings(&sensor, &format!("get {name}")).trim_end(), value);
    }
    let now = sensor.state().settings();
    assert_eq!((now.rows, now.stream, now.echo), (64, false, true));
    assert_eq!(sensor.state().saved_rows(), None);
    ends(
        &settings(&sensor, "set rows 32 --save"),
        "saved: the settings are kept over a power cycle\n",
    );
    assert_eq!(sensor.state().saved_rows(), Some(32));
}

/// Whatever `units` the sensor has, an exported file names the unit, and a file without one is refused.
#[test]
fn lengths_follow_the_units_of_the_sensor() {
    for (seed, units, typed, shown, remark) in [
        (8, "mm", "790 810", "790 810 mm", ""),
        (9, "um", "790000.5 810000", "790000.5 810000 um", ""),
        (10, "um", "790 810 mm", "790000 810000 um", ""),
        (
            11,
            "mm",
            "100 810",
            "100 810 mm",
            "(beyond what the calibration measures, ",
        ),
    ] {
        let sensor = StandIn::new(seed);
        sensor.state().type_line(&format!("units {units}"));
        let output = settings(&sensor, &format!("set limits {typed}"));
        begins(&output, &format!("limits {shown} (it was off)\n{remark}"));
        assert_eq!(settings(&sensor, "get limits").trim_end(), shown);
        let number = shown.split(' ').next().expect("a number");
        says(
            &settings(&sensor, ""),
            [format!("limits          {number} ")],
        );
        settings(&sensor, "export @bench.toml");
        let text = std::fs::read_to_string(sensor.file("bench.toml")).expect("a file");
        let line = text.lines().find(|line| line.starts_with("limits = "));
        assert!(line.is_some_and(|line| line.ends_with(" mm\"")), "{line:?}");
        let before = sensor.state().settings();
        sensor.state().type_line("limits off");
        begins(&settings(&sensor, "import @bench.toml"), "limits: off -> ");
        assert_eq!(sensor.state().settings(), before);
        let wrong = format!("set limits 10 9 {units}");
        says(
            &refused(&sensor, &wrong),
            [format!("] {units}, -8000"), "LOW first".to_owned()],
        );
        sensor.write(
            "old.toml",
            "limits = \"790000 810000\"\nspike-filter = 500\n",
        );
        let error = refused(&sensor, "import @old.toml");
        says(
            &error,
            [
                "`limits 790000 810000` has no unit",
                "or `500 um` as older files mean",
            ],
        );
    }
}

#[test]
fn a_wrong_value_is_an_error_that_names_the_right_ones() {
    let sensor = StandIn::new(3);
    let mut errors = String::new();
    let commands =
        "set rows 65; set rows; set rose 3; set black fixed; set save; get exposure limits";
    for words in commands.split("; ") {
        let error = refused(&sensor, words);
        // The list of all settings, which grows, follows.
        let error = error.split(" The settings are: ").next();
        errors += &format!("{words}: {}\n", error.unwrap_or_default());
    }
    insta::assert_snapshot!(errors);
    assert_eq!(sensor.state().settings(), Settings::default());
}

/// It would no longer answer the tool.
#[test]
fn a_sensor_stays_alone_on_its_line() {
    let sensor = StandIn::new(7);
    let reason = "the tool talks to a sensor that is alone on its line: `address 0`, and not `format modbus`";
    for words in ["address 5", "address 247", "format modbus"] {
        let error = format!("`{words}` is not set here: {reason}");
        assert_eq!(refused(&sensor, &format!("set {words}")), error);
        let (name, value) = words.split_once(' ').expect("a value");
        sensor.write("alone.toml", format!("rows = 4\n{name} = \"{value}\"\n"));
        assert_eq!(refused(&sensor, "import @alone.toml"), error);
    }
    // Time goes on as soon as anything is sent.
    assert_eq!(sensor.now(), std::time::Duration::ZERO);
    assert_eq!(sensor.state().settings(), Settings::default());
    let output = settings(&sensor, "set address 0");
    assert_eq!(output, "address 0 (as before)\n");
}

#[test]
fn a_file_moves_settings_from_one_sensor_to_another() {
    let [first, second] = [4, 5].map(StandIn::new);
    let lines = "rows 32; estimator phase-table";
    first.state().type_lines(lines);
    settings(&first, "export @bench.toml");
    let (bench, port) = (first.file("bench.toml"), second.port());
    let on_second = |command: &str| {
        let (code, output) = second.run(&format!("settings --port PORT {command} {bench}"));
        (code.expect("an answer"), output)
    };
    let (code, output) = on_second("compare");
    assert_eq!(code, ExitCode::from(1));
    says(&output, [format!("rows: 16 at {port}, 32 in {bench}\n")]);
    let (_, output) = on_second("import --save");
    begins(&output, "rows: 16 -> 32\n");
    let changed = "estimator: adaptive -> phase-table\n2 settings changed, ";
    says(&output, [changed]);
    ends(&output, "saved: the settings are kept over a power cycle\n");
    assert_eq!(on_second("compare").0, ExitCode::SUCCESS);
    begins(&on_second("import").1, "0 settings changed, ");
    second.state().type_line("rows 16");
    let changed = "rows: 16 -> 32\n1 setting changed, ";
    says(&on_second("import").1, [changed]);
    // They are in flash: a start keeps them.
    assert_eq!(second.state().saved_rows(), Some(32));
    assert_eq!(second.state().settings(), first.state().settings());
}

#[test]
fn a_file_with_a_wrong_line_changes_nothing() {
    let sensor = StandIn::new(6);
    sensor.write("wrong.toml", "mean = \"plain\"\nrows = 100\n");
    let error = refused(&sensor, "import @wrong.toml");
    says(&error, ["`rows 100`: out of range, expected rows 1..64"]);
    assert_eq!(sensor.state().settings(), Settings::default());
}
