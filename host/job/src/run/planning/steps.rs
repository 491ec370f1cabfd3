//! The steps of a search that are kept in memory, so that the next one goes on from the first that an edit changes: a seam that is
//! asked for is sought among those that were found, and what is excluded is cut from views that are merged.

use std::fmt::Debug;
use std::sync::Arc;

use crate::run::kept::{Key, Shelf};
use weldpath_method::input::Scan;
use weldpath_method::pipeline::{self, Kept, MergedViews, Observer, Plan, PlanError, Step, Survey};

use super::Search;

/// A scan whose views are merged.
pub(super) struct Begun {
    /// Without the points of its views.
    pub(super) scan: Scan,
    merged: Step<MergedViews>,
}

/// What the last search went through. It is as large as the scan itself, so only one is kept.
pub(super) struct Steps {
    begun: Shelf<Begun>,
    surveys: Shelf<Step<Survey>>,
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
        observer: &mut dyn Observer,
    ) -> Result<Plan, PlanError> {
        if search.is_touched() {
            return search.run(scan, observer);
        }
        match self.begun(search, content) {
            Some(begun) => self.go_on(&begun, search, content, observer),
            None => self.plan(None, scan, search, content, observer),
        }
    }

    /// The search from where the views are merged.
    pub(super) fn go_on(
        &self,
        begun: &Begun,
        search: &Search,
        content: Key,
        observer: &mut dyn Observer,
    ) -> Result<Plan, PlanError> {
        self.plan(Some(begun.merged.clone()), &begun.scan, search, content, observer)
    }

    fn plan(
        &self,
        merged: Option<Step<MergedViews>>,
        scan: &Scan,
        search: &Search,
        content: Key,
        observer: &mut dyn Observer,
    ) -> Result<Plan, PlanError> {
        let survey = self.surveys.recent(search.survey_key(content)).map(|survey| (*survey).clone());
        let mut kept = Kept { merged, survey };
        let plan = pipeline::plan_from(&mut kept, &scan.views, &search.config(scan), observer);
        if let Some(merged) = kept.merged {
            let begun = Begun { scan: scan.without_points(), merged };
            self.begun.remember(search.merge_key(content), &Arc::new(begun));
        }
        if let Some(survey) = kept.survey {
            self.surveys.remember(search.survey_key(content), &Arc::new(survey));
        }
        Ok(search.with_words_of(scan, plan?))
    }
}
