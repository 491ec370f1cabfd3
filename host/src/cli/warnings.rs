//! Warnings as a terminal shows them: like ones together and counted, the worst first, never more than a few lines. All of
//! them are in summary.json and in the report.

/// Lines at most.
const MOST_LINES: usize = 8;

/// What makes a warning worse than others, the worst first: what the torch would hit, what is not known, what the robot
/// cannot do. The words are those of the warnings.
const WORST: [&str; 9] =
    ["inside", "collid", "hits", "UNKNOWN", "uncertain", "not held", "cannot", "reach", "left out"];

/// The lines for these warnings.
pub(super) fn lines(warnings: &[String]) -> Vec<String> {
    if warnings.len() <= MOST_LINES {
        return warnings.to_vec();
    }
    let mut groups: Vec<(String, &String, usize)> = Vec::new();
    for warning in warnings {
        let kind = kind(warning);
        match groups.iter_mut().find(|(known, _, _)| *known == kind) {
            Some((_, _, count)) => *count += 1,
            None => groups.push((kind, warning, 1)),
        }
    }
    // Stable: of equally bad ones those of the run come before those of the seams, as they were given.
    groups.sort_by_key(|(_, first, _)| badness(first));
    let told = if groups.len() > MOST_LINES { MOST_LINES - 1 } else { groups.len() };
    let rest: usize = groups[told..].iter().map(|(_, _, count)| count).sum();
    let line = |(_, first, count): &(String, &String, usize)| match count {
        1 => (*first).clone(),
        count => format!("{first} (and {} more of this kind)", count - 1),
    };
    let mut lines: Vec<String> = groups[..told].iter().map(line).collect();
    if rest > 0 {
        lines.push(format!("{rest} more; all {} are in summary.json and report.html", warnings.len()));
    }
    lines
}

/// A warning without its numbers: what differs by them only is of one kind.
fn kind(warning: &str) -> String {
    let mut kind = String::with_capacity(warning.len());
    for c in warning.chars() {
        match c {
            '0'..='9' | '.' | '-' | ',' => {
                if !kind.ends_with('#') {
                    kind.push('#');
                }
            }
            c => kind.push(c),
        }
    }
    kind
}

fn badness(warning: &str) -> usize {
    WORST.iter().position(|word| warning.contains(word)).unwrap_or(WORST.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixteen_warnings_of_which_eight_are_alike_take_few_lines_the_worst_first() {
        let mut warnings: Vec<String> =
            (0..8).map(|k| format!("seam {k}: {k}.5 mm were seen by one view only")).collect();
        warnings.extend((0..7).map(|k| format!("view {k} overlaps by {k} %")));
        warnings.push("the torch is 24.8 mm inside what was scanned".into());
        let lines = lines(&warnings);
        assert_eq!(lines.len(), 3, "{lines:?}");
        assert!(lines[0].starts_with("the torch is 24.8 mm inside"));
        assert_eq!(lines[1], "seam 0: 0.5 mm were seen by one view only (and 7 more of this kind)");
    }

    #[test]
    fn many_kinds_end_in_a_count_and_a_few_are_left_as_they_are() {
        let many: Vec<String> = ('a'..='t').map(|c| format!("kind {c}")).collect();
        let told = lines(&many);
        assert_eq!(
            (told.len(), told[7].as_str()),
            (8, "13 more; all 20 are in summary.json and report.html")
        );
        assert_eq!(lines(&many[..8]), many[..8]);
    }
}
