//! `docs/formats.md` describes what the program reads and writes.

use std::path::Path;

use weldpath::export::json;
use weldpath::job::Job;
use weldpath::postprocessing::postprocess;
use weldpath_tests::plans;

const FORMATS: &str = include_str!("../../docs/formats.md");

/// The first fenced block of this language.
fn block(language: &str) -> &'static str {
    let (_, rest) = FORMATS.split_once(&format!("```{language}\n")).unwrap();
    rest.split("```").next().unwrap()
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
    assert_eq!(documented.sampling(), default.sampling());
    assert_eq!(documented.motion(), default.motion());
    assert_eq!(documented.controller(), default.controller());
    assert_eq!(documented.selection, default.selection);
    assert_eq!((documented.units, documented.method), (default.units, default.method));
}

#[test]
fn every_commented_key_of_the_documented_job_is_accepted() {
    let all = block("toml")
        .replace("# points", "#points")
        .replace("\n# ", "\n")
        .replace("\"weldpath\"", "\"paper\"");
    let job = Job::parse(&all, Path::new("formats.md")).unwrap();
    assert!(
        job.ratio_threshold.is_some() && job.selection.near_mm.is_some() && job.selection.roi_mm.is_some()
    );
    assert!(job.arc.gas_output.is_some() && job.arc.established_input.is_some());
}

#[test]
fn the_documented_program_is_read() {
    assert_eq!(json::read(block("json")).unwrap().len(), 1);
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
