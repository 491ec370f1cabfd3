//! The report and the page that edits a job, in a browser where one is needed.

mod accessibility;
mod guide_pictures;
mod open;
mod open_page;
mod open_script;
mod report;
mod texts;
