//! The writer against folders in every state, and stopped before each of its operations.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::*;

fn named(names: &[&str]) -> Vec<File> {
    names.iter().map(|&name| File::new(name, name)).collect()
}

/// Everything below a folder but the hidden folder, by name.
fn tree(directory: &Path) -> BTreeMap<String, Vec<u8>> {
    fn walk(root: &Path, folder: &Path, found: &mut BTreeMap<String, Vec<u8>>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(root).unwrap().to_str().unwrap().to_owned();
            match path.is_dir() {
                true if name == STAGING => {}
                true => walk(root, &path, found),
                false => drop(found.insert(name, std::fs::read(&path).unwrap())),
            }
        }
    }
    let mut found = BTreeMap::new();
    if directory.is_dir() {
        walk(directory, directory, &mut found);
    }
    found
}

fn names(directory: &Path) -> Vec<String> {
    tree(directory).into_keys().filter(|name| name != manifest::NAME).collect()
}

#[test]
fn programs_of_an_earlier_run_are_named() {
    let home = tempfile::tempdir().unwrap();
    std::fs::write(home.path().join("notes.txt"), "mine").unwrap();
    write(home.path(), &named(&["path.script", "weldpath_2.src", "path.json"])).unwrap();
    let now = named(&["path.json", "weldpath.mod", "path.script"]);
    write(home.path(), &now).unwrap();
    assert_eq!(of_earlier_runs(home.path(), &now), ["weldpath_2.src"]);
    assert_eq!(of_earlier_runs(&home.path().join("none"), &now), [""; 0]);
}

#[test]
fn all_files_are_written_and_nothing_else() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("a/b");
    write(&out, &[File::new("one", "1"), File::new("deep/two", "2")]).unwrap();
    assert_eq!(names(&out), ["deep/two", "one"]);
    write(&out, &[File::new("one", "new")]).unwrap();
    assert_eq!(std::fs::read_to_string(out.join("one")).unwrap(), "new");
    assert_eq!(std::fs::read_to_string(out.join("deep/two")).unwrap(), "2");
    assert!(!out.join(STAGING).exists());
}

#[test]
fn a_file_that_cannot_be_replaced_leaves_all_of_them_as_they_were() {
    let home = tempfile::tempdir().unwrap();
    write(home.path(), &[File::new("one", "old")]).unwrap();
    std::fs::create_dir(home.path().join("three")).unwrap();
    let before = tree(home.path());
    let files = [File::new("one", "1"), File::new("two", "2"), File::new("three", "3")];
    let error = write(home.path(), &files).unwrap_err();
    assert!(error.to_string().contains("three"), "{error}");
    assert_eq!(tree(home.path()), before);
    assert!(!home.path().join(STAGING).exists());
}

#[test]
fn a_folder_that_cannot_be_made_is_named() {
    let home = tempfile::tempdir().unwrap();
    let blocked = home.path().join("file");
    std::fs::write(&blocked, "").unwrap();
    assert!(check(&blocked.join("out"), &[], false).is_err());
    assert!(check(&home.path().join("a/b"), &[], false).is_ok());
    let error = write(&blocked.join("out"), &[File::new("one", "1")]).unwrap_err();
    assert!(error.to_string().contains("file"), "{error}");
    assert_eq!(names(home.path()), ["file"]);
}

#[test]
fn a_folder_made_for_a_run_that_fails_is_gone_again() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("a/b");
    let files = [File::new("one", "1"), File::new("one/two", "2")];
    assert!(write(&out, &files).is_err());
    assert_eq!(std::fs::read_dir(home.path()).unwrap().count(), 0);
}

#[test]
fn what_weldpath_did_not_write_is_replaced_only_if_that_is_asked_for() {
    let home = tempfile::tempdir().unwrap();
    std::fs::write(home.path().join("path.csv"), "mine").unwrap();
    let files = named(&["path.csv", "path.json"]);
    for error in
        [write(home.path(), &files).unwrap_err(), check(home.path(), &["path.csv"], false).unwrap_err()]
    {
        assert!(error.to_string().contains("path.csv (not written by weldpath)"), "{error}");
    }
    assert_eq!(names(home.path()), ["path.csv"]);
    assert_eq!(std::fs::read_to_string(home.path().join("path.csv")).unwrap(), "mine");
    Writer::new(home.path()).overwrite(true).write(&files).unwrap();
    write(home.path(), &files).unwrap();
}

#[test]
fn a_program_that_was_edited_is_named_and_stays() {
    let home = tempfile::tempdir().unwrap();
    let (first, second) = ([File::new("path.script", "sleep(1)")], [File::new("path.script", "sleep(2)")]);
    write(home.path(), &first).unwrap();
    write(home.path(), &second).unwrap();
    std::fs::write(home.path().join("path.script"), "sleep(9)").unwrap();
    let error = write(home.path(), &first).unwrap_err();
    assert!(error.to_string().contains("path.script (changed since weldpath wrote it)"), "{error}");
    assert_eq!(std::fs::read_to_string(home.path().join("path.script")).unwrap(), "sleep(9)");
    // What was changed to just what is written now is no loss.
    write(home.path(), &[File::new("path.script", "sleep(9)")]).unwrap();
}

#[test]
fn the_job_that_a_run_was_given_may_be_written_anew() {
    let home = tempfile::tempdir().unwrap();
    write(home.path(), &[File::new("job.toml", "a = 1")]).unwrap();
    let job = home.path().join("job.toml");
    std::fs::write(&job, "a = 2 # edited").unwrap();
    let files = [File::new("job.toml", "a = 2")];
    assert!(write(home.path(), &files).is_err());
    Writer::new(home.path()).given(Some(&job)).write(&files).unwrap();
}

#[test]
fn a_manifest_of_somebody_else_is_not_touched() {
    let home = tempfile::tempdir().unwrap();
    std::fs::write(home.path().join(manifest::NAME), "{}").unwrap();
    let error = write(home.path(), &named(&["a"])).unwrap_err();
    assert!(error.to_string().contains(manifest::NAME), "{error}");
}

#[test]
fn two_runs_do_not_write_at_once() {
    let home = tempfile::tempdir().unwrap();
    let inner = AtomicUsize::new(0);
    let before = |operation: Operation<'_>| {
        if operation == Operation::Commit {
            let second = write(home.path(), &named(&["b"]));
            assert!(matches!(second, Err(Error::Busy { .. })), "{second:?}");
            inner.fetch_add(1, Ordering::SeqCst);
        }
        Ok(())
    };
    Writer::new(home.path()).watched(&before).write(&named(&["a"])).unwrap();
    assert_eq!((inner.into_inner(), names(home.path())), (1, vec!["a".to_owned()]));
}

/// Old files and the files of a run that replaces two of them, adds two, and leaves one alone.
fn old_and_new() -> (Vec<File>, Vec<File>) {
    let old = named(&["one", "two", "deep/three"]);
    let new = ["one", "deep/three", "four", "deeper/five"].map(|name| File::new(name, format!("new {name}")));
    (old, new.into())
}

#[test]
fn an_error_before_any_operation_leaves_everything_as_it_was() {
    let (old, new) = old_and_new();
    for at in 0.. {
        let home = tempfile::tempdir().unwrap();
        write(home.path(), &old).unwrap();
        let before = tree(home.path());
        let count = AtomicUsize::new(0);
        let fail = |_: Operation<'_>| match count.fetch_add(1, Ordering::SeqCst) == at {
            true => Err(io::Error::other("no more")),
            false => Ok(()),
        };
        let result = Writer::new(home.path()).watched(&fail).write(&new);
        if count.into_inner() <= at {
            assert!(at > 15, "only {at} operations were watched");
            return result.map(drop).unwrap();
        }
        // Nobody stops it when all is in place.
        if result.is_err() {
            assert_eq!(tree(home.path()), before, "failed before operation {at}");
        }
        assert!(!home.path().join(STAGING).exists());
    }
}

#[test]
fn a_panic_before_any_operation_is_settled_by_the_next_run() {
    let (old, new) = old_and_new();
    let whole = |files: &[&[File]]| {
        let home = tempfile::tempdir().unwrap();
        files.iter().for_each(|files| write(home.path(), files).unwrap());
        tree(home.path())
    };
    let (all_old, all_new) = (whole(&[&old]), whole(&[&old, &new]));
    let (mut finished, mut removed) = (0, 0);
    for at in 0.. {
        let home = tempfile::tempdir().unwrap();
        write(home.path(), &old).unwrap();
        let count = AtomicUsize::new(0);
        let die = |_: Operation<'_>| {
            assert!(count.fetch_add(1, Ordering::SeqCst) != at, "as if the power went");
            Ok(())
        };
        let run = || Writer::new(home.path()).watched(&die).write(&new);
        if std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).is_ok() {
            break;
        }
        let left = settle(home.path()).unwrap();
        let now = tree(home.path());
        match left {
            Some(Left::Finished) => finished += usize::from(now == all_new),
            _ => removed += usize::from(now == all_old || now == all_new),
        }
        assert!(now == all_old || now == all_new, "died before operation {at}, {left:?}: {:?}", now.keys());
        assert!(!home.path().join(STAGING).exists());
    }
    assert!(finished >= 5 && removed >= 10, "{finished} finished, {removed} removed");
}

#[test]
fn a_dead_run_that_was_turning_back_is_turned_back() {
    let (old, new) = old_and_new();
    let mut undone = 0;
    for at in 0.. {
        let home = tempfile::tempdir().unwrap();
        write(home.path(), &old).unwrap();
        let before = tree(home.path());
        let count = AtomicUsize::new(0);
        // The third file cannot be put in place, and amid what follows the run dies.
        let installed = AtomicUsize::new(0);
        let die = |operation: Operation<'_>| {
            let back = matches!(operation, Operation::PutBack(_) | Operation::Forget | Operation::Clean);
            assert!(!(back && count.fetch_add(1, Ordering::SeqCst) == at), "as if the power went");
            let third =
                matches!(operation, Operation::Install(_)) && installed.fetch_add(1, Ordering::SeqCst) == 2;
            if third { Err(io::Error::other("refused")) } else { Ok(()) }
        };
        let run = || Writer::new(home.path()).watched(&die).write(&new);
        let died = std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).is_err();
        undone += usize::from(settle(home.path()).unwrap() == Some(Left::Undone));
        assert_eq!(tree(home.path()), before, "died at step {at} of the way back");
        if !died {
            break;
        }
    }
    assert!(undone >= 4, "{undone}");
}

#[test]
fn a_journal_that_names_files_outside_is_not_followed() {
    let home = tempfile::tempdir().unwrap();
    let staging = home.path().join("out").join(STAGING);
    std::fs::create_dir_all(staging.join("new")).unwrap();
    std::fs::write(staging.join("new/x"), "").unwrap();
    std::fs::write(staging.join("journal"), r#"[{"name":"../x","replaces":false}]"#).unwrap();
    assert!(settle(&home.path().join("out")).is_err());
    assert!(!home.path().join("x").exists() && staging.join("journal").exists());
}
