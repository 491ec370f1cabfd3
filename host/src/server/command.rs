//! What was clicked, as a command that can be pasted into any shell.

use std::path::Path;

use weldpath_job::run::job::Job;

/// Ends the job in the command's text, unless it is a line of it: a name of a file may have several.
const END: &str = "END_OF_JOB";

/// How the files of a run are written.
#[derive(Debug, Clone, Copy)]
pub(super) struct Target<'a> {
    pub out: &'a Path,
    pub overwrite: bool,
    pub allow_outside: bool,
}

/// A command that plans this job: `weldpath plan` with the job on its standard input, without what is left to a default.
pub(super) fn command(job: &Job, target: Target<'_>) -> String {
    let flags = [(target.overwrite, " --overwrite"), (target.allow_outside, " --allow-outside")];
    let flags: String = flags.into_iter().filter(|(on, _)| *on).map(|(_, flag)| flag).collect();
    let out = quoted(&target.out.to_string_lossy());
    let said = said(job);
    let mut end = END.to_owned();
    while said.lines().any(|line| line == end) {
        end.push('_');
    }
    format!("weldpath plan --job /dev/stdin --out {out}{flags} <<'{end}'\n{said}{end}\n")
}

/// What a job says beyond the defaults.
fn said(job: &Job) -> String {
    let [said, default] = [job, &Job::default()].map(|job| toml::Table::try_from(job).unwrap_or_default());
    toml::to_string(&without(said, &default)).unwrap_or_default()
}

/// A table without what is the same in another.
fn without(table: toml::Table, default: &toml::Table) -> toml::Table {
    let differs = |(key, value): (String, toml::Value)| match (value, default.get(&key)) {
        (toml::Value::Table(inner), Some(toml::Value::Table(default))) => {
            let left = without(inner, default);
            (!left.is_empty()).then_some((key, toml::Value::Table(left)))
        }
        (value, default) => (default != Some(&value)).then_some((key, value)),
    };
    table.into_iter().filter_map(differs).collect()
}

/// A word of a shell that is nothing but this text.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(job: &Job, out: &str) -> String {
        command(job, Target { out: Path::new(out), overwrite: false, allow_outside: false })
    }

    #[test]
    fn only_what_is_not_a_default_is_said_and_reads_back_as_the_same_job() {
        let text = "formats = [\"abb\"]\n[path]\nfeed_mm_s = 6\n[order]\nsequence = \"listed\"\n[[seam]]\nid = 2\nweld = false\n";
        let job = Job::parse(text, Path::new("job.toml")).unwrap();
        let said = said(&job);
        assert!(said.lines().count() < 12, "{said}");
        assert_eq!(Job::parse(&said, Path::new("job.toml")).unwrap(), job);
        assert!(super::said(&Job::default()).is_empty());
    }

    #[test]
    fn no_name_of_a_file_ends_the_text_or_begins_a_command() {
        let evil = format!("a\n{END}\nrm -rf '$HOME'");
        let text = of(&Job { input: Some(evil.clone().into()), ..Job::default() }, "o'; rm x '");
        let end = format!("{END}_");
        assert_eq!(text.lines().filter(|line| *line == end).count(), 1, "{text}");
        assert!(text.contains(&format!("<<'{end}'\n")), "{text}");
        assert!(text.contains(r"--out 'o'\''; rm x '\''' <<"), "{text}");
        let job = text.split_once("'\n").unwrap().1.strip_suffix(&format!("{end}\n")).unwrap();
        assert_eq!(Job::parse(job, Path::new("x")).unwrap().input, Some(evil.into()));
    }
}
