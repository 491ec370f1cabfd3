//! `docs/formats.md` describes what the program reads and writes.

use std::path::Path;

use serde_json::Value;
use weldpath::output::verdict::ReasonId;
use weldpath::output::{json, views};
use weldpath::run::job::Job;
use weldpath::run::postprocessing::postprocess;
use weldpath_tests::markdown::blocks;
use weldpath_tests::plans;

const FORMATS: &str = include_str!("../../../docs/formats.md");

const TROUBLESHOOTING: &str = include_str!("../../../docs/troubleshooting.md");
const FEASIBILITY: &str = include_str!("../../../docs/feasibility.md");
const PROGRAMS: &str = include_str!("../../../docs/programs.md");

/// The first fenced block of this language.
fn block(language: &str) -> &'static str {
    blocks(FORMATS, language)[0]
}

/// The first column of the table that follows `heading`.
fn keys(heading: &str) -> Vec<&'static str> {
    let (_, section) = FORMATS.split_once(heading).unwrap();
    let rows = section.lines().skip_while(|line| !line.starts_with("|---")).skip(1);
    rows.take_while(|line| line.starts_with('|'))
        .flat_map(|row| row.split('|').nth(1).unwrap().split(','))
        .map(|cell| cell.trim().trim_matches('`'))
        .collect()
}

#[test]
fn the_documented_job_is_the_default_job() {
    let documented = Job::parse(block("toml"), Path::new("formats.md")).unwrap();
    let default = Job { input: documented.input.clone(), tool: documented.tool.clone(), ..Job::default() };
    assert_eq!(documented.weld().filled(), default.weld().filled());
    assert_eq!(documented.order, default.order);
    assert_eq!(documented.program_setup(), default.program_setup());
    assert_eq!(documented.selection, default.selection);
    assert_eq!((documented.units, documented.method), (default.units, default.method));
    assert_eq!(documented.scan, default.scan);
}

#[test]
fn every_commented_key_of_the_documented_job_is_accepted() {
    let all = block("toml")
        .replace("# points", "#points")
        .replace("# frequency_hz", "#frequency_hz")
        .replace("\n# ", "\n")
        .replace("\"weldpath\"", "\"paper\"");
    let job = Job::parse(&all, Path::new("formats.md")).unwrap();
    assert!(
        job.ratio_threshold.is_some() && job.selection.near_mm.is_some() && job.selection.roi_mm.is_some()
    );
    assert!(job.arc.gas_output.is_some() && job.arc.established_input.is_some());
    assert!(job.path.retract_mm.is_some() && job.weave.height_mm.is_some());
}

#[test]
fn the_documented_seams_and_passes_are_accepted_on_top_of_the_job() {
    let job = Job::parse(block("toml seams"), Path::new("formats.md")).unwrap();
    let passes = job.weld().passes();
    assert_eq!((passes[0].0.across_mm, passes[0].0.reverse, passes[0].1.feed_mm_s), (-2.0, true, 6.0));
    let seam = job.seams[0].weld().on(&job.weld());
    assert_eq!((seam.passes().len(), seam.motion().feed_mm_s), (1, 7.0));
    let near = block("toml seams").replace("id = 2 ", "# ").replace("# near_mm", "near_mm");
    assert!(Job::parse(&near, Path::new("formats.md")).unwrap().seams[0].near_mm.is_some());
}

#[test]
fn the_documented_calibration_is_accepted_in_a_job() {
    let job = Job::parse(block("toml calibration"), Path::new("formats.md")).unwrap();
    let calibration = job.scan.calibration.expect("one is given").calibration();
    assert_eq!((calibration.camera.focal, calibration.covariance[(2, 1)]), (0.005, 3e-7));
    assert_eq!(calibration.covariance[(1, 2)], 3e-7);
}

/// Every key of a schema's objects, wherever they stand.
fn schema_keys(schema: &Value, keys: &mut Vec<String>) {
    if let Some(properties) = schema["properties"].as_object() {
        keys.extend(properties.keys().cloned());
    }
    match schema {
        Value::Object(map) => map.values().for_each(|value| schema_keys(value, keys)),
        Value::Array(list) => list.iter().for_each(|value| schema_keys(value, keys)),
        _ => {}
    }
}

/// Keys of the documented jobs, those in comments as well.
fn documented_keys() -> Vec<String> {
    let key = |line: &str| {
        let line = line.trim_start_matches("# ");
        let name = line.split(" = ").next().filter(|name| *name != line)?;
        let bare = name.rsplit('.').next()?;
        bare.chars()
            .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
            .then(|| bare.to_owned())
    };
    let of_the_robot = [FEASIBILITY, PROGRAMS].into_iter().flat_map(|page| blocks(page, "toml"));
    let blocks =
        [block("toml"), block("toml seams"), block("toml calibration")].into_iter().chain(of_the_robot);
    blocks.flat_map(|text| text.lines().filter_map(key)).collect()
}

#[test]
fn the_committed_schema_is_that_of_the_job_and_has_every_documented_key_and_no_other() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let committed = std::fs::read_to_string(root.join("docs/job.schema.json")).unwrap();
    assert!(committed == Job::schema(), "write it anew: weldpath schema > docs/job.schema.json");
    let mut known = Vec::new();
    schema_keys(&serde_json::from_str(&committed).unwrap(), &mut known);
    let tables = [
        "scan",
        "calibration",
        "exclude",
        "half_space",
        "selection",
        "order",
        "path",
        "torch",
        "weave",
        "stitch",
        "arc",
        "tool",
        "pass",
        "seam",
        "touch",
        "ask",
        "draw",
        "program",
        "robot",
        "opw",
        "resume",
        "torch_body",
    ];
    let documented = documented_keys();
    assert!(documented.len() > 45, "{documented:?}");
    for key in &documented {
        assert!(known.contains(key), "{key} is not in the schema");
    }
    for key in known.iter().filter(|key| !tables.contains(&key.as_str())) {
        assert!(documented.contains(key), "{key} is not documented");
    }
}

/// JSON Schema 2020-12, section 6 of its validation part, as far as the job's schema goes; another keyword is a failure.
fn is_valid(value: &Value, schema: &Value, root: &Value) -> bool {
    let Some(keywords) = schema.as_object() else { return schema.as_bool().unwrap() };
    keywords.iter().all(|(keyword, rule)| match keyword.as_str() {
        "$schema" | "$defs" | "title" | "description" | "default" | "format" => true,
        "$ref" => is_valid(value, root.pointer(&rule.as_str().unwrap()[1..]).unwrap(), root),
        "type" => match rule {
            Value::Array(types) => types.iter().any(|name| is_a(value, name)),
            name => is_a(value, name),
        },
        "enum" => rule.as_array().unwrap().contains(value),
        "const" => rule == value,
        "anyOf" => rule.as_array().unwrap().iter().any(|one| is_valid(value, one, root)),
        "oneOf" => rule.as_array().unwrap().iter().filter(|one| is_valid(value, one, root)).count() == 1,
        "minimum" => value.as_f64().is_none_or(|v| v >= rule.as_f64().unwrap()),
        "maximum" => value.as_f64().is_none_or(|v| v <= rule.as_f64().unwrap()),
        "minItems" => value.as_array().is_none_or(|v| v.len() as u64 >= rule.as_u64().unwrap()),
        "maxItems" => value.as_array().is_none_or(|v| v.len() as u64 <= rule.as_u64().unwrap()),
        "items" => value.as_array().is_none_or(|v| v.iter().all(|item| is_valid(item, rule, root))),
        "required" => value
            .as_object()
            .is_none_or(|v| rule.as_array().unwrap().iter().all(|key| v.contains_key(key.as_str().unwrap()))),
        "properties" => {
            let known =
                |(key, item): (&String, &Value)| rule.get(key).is_none_or(|one| is_valid(item, one, root));
            value.as_object().is_none_or(|v| v.iter().all(known))
        }
        "additionalProperties" => {
            let known = |key: &String| schema["properties"].get(key).is_some();
            value
                .as_object()
                .is_none_or(|v| v.iter().all(|(key, item)| known(key) || is_valid(item, rule, root)))
        }
        "propertyNames" => value
            .as_object()
            .is_none_or(|v| v.keys().all(|key| is_valid(&Value::String(key.clone()), rule, root))),
        other => panic!("the checker does not know {other}"),
    })
}

fn is_a(value: &Value, name: &Value) -> bool {
    match name.as_str().unwrap() {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "null" => value.is_null(),
        "number" => value.is_number(),
        "integer" => value.as_f64().is_some_and(|v| v.fract() == 0.0),
        other => panic!("the checker does not know the type {other}"),
    }
}

#[test]
fn the_schema_accepts_the_documented_jobs_and_refuses_slips() {
    let schema: Value = serde_json::from_str(&Job::schema()).unwrap();
    let valid = |text: &str| is_valid(&toml::from_str::<Value>(text).unwrap(), &schema, &schema);
    let jobs = [block("toml"), block("toml seams"), &Job::default().to_toml()];
    for text in jobs {
        assert!(valid(text), "{text}");
    }
    for (text, slip) in [
        ("[path]\nfeed_mm_s = 8", "[path]\nfeed_m_s = 0.008"),
        ("[path]\nfeed_mm_s = 8", "[path]\nfeed_mm_s = 800"),
        ("[path]\nfeed_mm_s = 8", "[path]\nfeed_mm_s = \"8\""),
        ("[weave]\nshape = \"sine\"", "[weave]\nshape = \"sinus\""),
        ("[[seam]]\nid = 1", "[[seam]]\nid = \"first\""),
        ("[[pass]]\ntorch.turn_deg = 5", "[[pass]]\ntorch.turn = 5"),
        ("[joint.lap]\npath.feed_mm_s = 8", "[joint.scarf]\npath.feed_mm_s = 8"),
        ("[[seam]]\nid = 1\njoint = \"lap\"", "[[seam]]\nid = 1\njoint = \"scarf\""),
        ("[order]\nup = [0, 0, 1]", "[order]\nup = [0, 1]"),
        ("[path]\npoints = 9", "[path]\npoints = 9.5"),
    ] {
        assert!(valid(text), "{text}");
        assert!(!valid(slip), "{slip}");
        assert!(Job::parse(slip, Path::new("job.toml")).is_err(), "{slip}");
    }
}

#[test]
fn the_documented_program_is_read() {
    assert_eq!(json::read(block("json")).unwrap().0.len(), 1);
}

#[test]
fn every_reason_of_a_verdict_is_documented_with_what_it_makes_and_no_other() {
    let (_, section) = TROUBLESHOOTING.split_once("## The verdict").unwrap();
    let section = section.split("\n### ").next().unwrap();
    let row = |line: &'static str| {
        let mut cells = line.strip_prefix("| `")?.split(" | ");
        Some((cells.next()?.trim_matches('`'), cells.next()?))
    };
    let documented: Vec<(&str, &str)> = section.lines().filter_map(row).collect();
    let known: Vec<(&str, &str)> = ReasonId::ALL.iter().map(|id| (id.name(), id.state().name())).collect();
    assert_eq!(documented, known);
}

#[test]
fn every_key_of_the_views_is_documented_and_no_other() {
    let plan = plans::pipe_and_bend();
    let views: Value = serde_json::from_str(&views::write(&plan.derived.views)).unwrap();
    let mut written: Vec<&str> = views["views"][0].as_object().unwrap().keys().map(String::as_str).collect();
    let mut documented = keys("## views.json");
    documented.sort_unstable();
    written.sort_unstable();
    assert_eq!(documented, written);
}

#[test]
fn every_key_of_the_summary_is_documented_and_no_other() {
    let output = postprocess(&plans::pipe_and_bend(), &Job::default(), Default::default()).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&output.summary.to_json()).unwrap();
    let mut written: Vec<&str> = summary.as_object().unwrap().keys().map(String::as_str).collect();
    written.retain(|key| !["format", "version"].contains(key));
    let mut documented = keys("## summary.json");
    documented.sort_unstable();
    written.sort_unstable();
    assert_eq!(documented, written);
    for key in
        summary["seams"][0].as_object().unwrap().keys().chain(summary["views"][0].as_object().unwrap().keys())
    {
        assert!(FORMATS.contains(&format!("`{key}`")), "{key} is not documented");
    }
}
