//! The steps of a search that are kept in memory, so that the next one goes on from the first that an edit changes: a seam that is
//! asked for is sought among those that were found, and what is excluded is cut from views that are merged.

use std::fmt::Debug;
use std::sync::Arc;

use crate::input::Scan;
use crate::pipeline::survey::{MergedViews, Survey};
use crate::pipeline::{Observer, Plan, PlanError};
use crate::run::kept::{Key, Shelf};

use super::Search;

/// A scan whose views are merged.
pub(super) struct Begun {
    /// Without the points of its views.
    pub(super) scan: Scan,
    merged: Arc<MergedViews>,
}

/// What the last search went through. It is as large as the scan itself, so only one is kept.
pub(super) struct Steps {
    begun: Shelf<Begun>,
    surveys: Shelf<Survey>,
}

impl Default for Steps {
    fn default() -> Self {
        Self { begun: Shelf::of_the_last(1), surveys: Shelf::of_the_last(1) }
    }
}

impl Debug for Steps {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Steps").finish_non_exhaustive()
    }
}

impl Steps {
    /// What is kept of the scan, if it is enough for the search. A touched scan is planned twice, and is not kept.
    pub(super) fn begun(&self, search: &Search, content: Key) -> Option<Arc<Begun>> {
        let begun = || self.begun.recent(search.merge_key(content));
        (!search.is_touched()).then(begun).flatten()
    }

    /// The whole search, of which the steps are kept.
    pub(super) fn run(
        &self,
        search: &Search,
        scan: &Scan,
        content: Key,
        observer: &mut impl Observer,
    ) -> Result<Plan, PlanError> {
        if search.is_touched() {
            return search.run(scan, observer);
        }
        let begun = match self.begun(search, content) {
            Some(begun) => begun,
            None => {
                let merged = MergedViews::new(&scan.views, &search.config(scan).of_merge(), observer)?;
                let begun = Arc::new(Begun { scan: scan.without_points(), merged: merged.into() });
                self.begun.remember(search.merge_key(content), &begun);
                begun
            }
        };
        self.go_on(&begun, search, content, observer)
    }

    /// The search from where the views are merged.
    pub(super) fn go_on(
        &self,
        begun: &Begun,
        search: &Search,
        content: Key,
        observer: &mut impl Observer,
    ) -> Result<Plan, PlanError> {
        let config = search.config(&begun.scan);
        let key = search.survey_key(content);
        let survey = match self.surveys.recent(key) {
            Some(survey) => survey,
            None => {
                let survey = Arc::new(Survey::new(Arc::clone(&begun.merged), &config.of_survey(), observer)?);
                self.surveys.remember(key, &survey);
                survey
            }
        };
        Ok(search.with_words_of(&begun.scan, survey.plan(&config, observer)?))
    }
}
