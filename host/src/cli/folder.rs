//! The folder of results: what may be replaced there, and what is told about it.

use std::path::Path;

use weldpath::files::{self, File, Left, Writer};

use super::{Exit, Failure, tell};

/// Options of every command that writes a folder.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub(super) struct FolderArgs {
    /// Replace files that weldpath did not write, or that were changed since
    #[arg(long)]
    overwrite: bool,
}

#[cfg(feature = "open")]
impl FolderArgs {
    /// Whether files are replaced that weldpath did not write.
    pub(super) fn overwrite(self) -> bool {
        self.overwrite
    }
}

/// A folder to write to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Folder<'a> {
    path: &'a Path,
    overwrite: bool,
    given: Option<&'a Path>,
    quiet: bool,
}

impl<'a> Folder<'a> {
    /// The folder at `path`.
    pub(super) fn new(path: &'a Path, args: FolderArgs, quiet: bool) -> Self {
        Self { path, overwrite: args.overwrite, given: None, quiet }
    }

    /// The run was told what to do by this file, so it may be written anew.
    pub(super) fn given(self, given: Option<&'a Path>) -> Self {
        Self { given, ..self }
    }

    /// Whether files may be written there, those that are written in any case among them. Before the work.
    pub(super) fn check(&self, certain: &[&str]) -> Result<(), Failure> {
        let left = files::check(self.path, certain, self.overwrite).map_err(not_written)?;
        self.tell_left(left);
        Ok(())
    }

    /// All files or none, and a word on those of an earlier run that stay beside them.
    pub(super) fn write(&self, files: &[File]) -> Result<(), Failure> {
        let writer = Writer::new(self.path).overwrite(self.overwrite).given(self.given);
        self.tell_left(writer.write(files).map_err(not_written)?);
        let old = files::of_earlier_runs(self.path, files);
        if !old.is_empty() && !self.quiet {
            let names = old.join(", ");
            tell(&format!(
                "warning: {}: {names}: of an earlier run and another plan; delete what you do not need",
                self.path.display()
            ));
        }
        Ok(())
    }

    fn tell_left(&self, left: Option<Left>) {
        if let Some(left) = left.filter(|_| !self.quiet) {
            tell(&format!("note: {}: {}", self.path.join(files::STAGING).display(), left.words()));
        }
    }
}

/// What a dead run left in a folder that is read is settled first: it may be half old and half new.
pub(super) fn settle(folder: &Path) -> Result<(), Failure> {
    match files::settle(folder) {
        Ok(left) => {
            Folder::new(folder, FolderArgs::default(), false).tell_left(left);
            Ok(())
        }
        Err(error) => Err(Failure::new(Exit::Input, error).hint(
            "a run was killed while it wrote there; give the right to write to this folder, or plan again",
        )),
    }
}

pub(super) fn not_written(error: files::Error) -> Failure {
    let hint = match error {
        files::Error::NotOurs { .. } => "choose another folder with --out, or replace them with --overwrite",
        files::Error::Busy { .. } => "wait for it to end, or choose another folder with --out",
        _ => "choose another folder with --out",
    };
    Failure::new(Exit::Output, error).hint(hint)
}
