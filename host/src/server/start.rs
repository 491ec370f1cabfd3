//! The page before anything is open: a folder that is typed, or a simulated example.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use hyper::StatusCode;
use serde::Deserialize;

use super::session::{Session, Workplace};
use weldpath_job::run::job::Job;

/// What was chosen on the start page; without `out` the results go where the command line has them.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(tag = "choose", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Choice {
    /// What is opened, as on the command line.
    Input {
        /// Folder or file.
        input: PathBuf,
        /// Folder of the results.
        out: Option<PathBuf>,
    },
    /// An example, simulated.
    Example {
        /// Folder of the results.
        out: Option<PathBuf>,
    },
}

/// Makes a job of a choice, or says in words why not.
pub type Chooser = dyn Fn(&Choice) -> Result<(Job, Workplace), String> + Send + Sync;

/// What the start page offers.
pub struct Start {
    /// Where the results go if nothing else is typed.
    pub out: PathBuf,
    /// Where the example goes.
    pub example: PathBuf,
    /// What makes a job of it: only this reads and writes what is typed.
    pub choose: Arc<Chooser>,
    /// Whether something is being opened.
    is_busy: AtomicBool,
}

impl Start {
    /// With nothing chosen yet.
    pub fn new(out: PathBuf, example: PathBuf, choose: Arc<Chooser>) -> Self {
        Self { out, example, choose, is_busy: AtomicBool::new(false) }
    }

    /// What the page shows, as JSON.
    pub(super) fn told(&self) -> String {
        let [out, example] = [&self.out, &self.example].map(|path| path.display().to_string());
        serde_json::json!({ "open": false, "out": out, "example": example }).to_string()
    }

    /// The session of what was chosen.
    ///
    /// # Errors
    /// In words, if nothing comes of it.
    pub(super) async fn open(&self, body: &[u8]) -> Result<Arc<Session>, (StatusCode, String)> {
        let choice: Choice =
            serde_json::from_slice(body).map_err(|error| (StatusCode::BAD_REQUEST, error.to_string()))?;
        if self.is_busy.swap(true, Ordering::SeqCst) {
            return Err((StatusCode::CONFLICT, "another page is opening something: wait for it".into()));
        }
        let choose = Arc::clone(&self.choose);
        // An example takes seconds to simulate, and other pages ask meanwhile.
        let chosen = tokio::task::spawn_blocking(move || choose(&choice)).await;
        self.is_busy.store(false, Ordering::SeqCst);
        match chosen {
            Ok(Ok((job, workplace))) => Ok(Session::new(job, workplace)),
            Ok(Err(words)) => Err((StatusCode::BAD_REQUEST, words)),
            Err(_) => Err((
                StatusCode::INTERNAL_SERVER_ERROR,
                "it could not be opened: the terminal says why".into(),
            )),
        }
    }
}
