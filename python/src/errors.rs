//! What goes wrong, as exceptions.

use std::fmt::Display;

use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyKeyboardInterrupt, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::type_object::PyTypeInfo;
use weldpath::output::verdict::ReasonId;
use weldpath::pipeline::PlanError;
use weldpath::robot::dialect::Dialect;
use weldpath::run::job;
use weldpath::run::postprocessing;
use weldpath::{Error, Withheld};

create_exception!(weldpath, WeldpathError, PyException, "What weldpath cannot do, in words.");
create_exception!(weldpath, InputError, WeldpathError, "The scan cannot be read or understood.");
create_exception!(
    weldpath,
    JobError,
    WeldpathError,
    "A setting that does not exist, or whose value is \
                                                      impossible."
);
create_exception!(
    weldpath,
    NoSeam,
    WeldpathError,
    "Nothing weldable is in view; the words say what was seen instead."
);
create_exception!(
    weldpath,
    Refused,
    WeldpathError,
    "The plan is refused: no path is handed out. `reasons` has its ids."
);
create_exception!(
    weldpath,
    Unconfirmed,
    WeldpathError,
    "A person has to confirm `reasons` before there is a program."
);
create_exception!(
    weldpath,
    OutputError,
    WeldpathError,
    "The folder cannot be written, or holds files of somebody else."
);
create_exception!(weldpath, InternalError, PyRuntimeError, "A fault of weldpath itself: please report it.");

pub(crate) fn python<E: PyTypeInfo>(error: impl Display) -> PyErr {
    PyErr::new::<E, _>(error.to_string())
}

pub(crate) fn job_error(error: &job::Error) -> PyErr {
    python::<JobError>(format!("{error}\n  hint: {}", error.hint()))
}

/// Why there is no run.
pub(crate) fn of_plan(error: &Error) -> PyErr {
    match error {
        Error::Job(error) => job_error(error),
        Error::Plan(PlanError::GivenUp) | Error::Selection(postprocessing::Error::GivenUp) => {
            PyKeyboardInterrupt::new_err(())
        }
        Error::Plan(PlanError::NoSeam { .. } | PlanError::TooSparse { .. }) => python::<NoSeam>(error),
        Error::Plan(PlanError::NoView { .. }) => python::<InputError>(error),
        Error::Plan(_) | Error::Selection(_) => python::<JobError>(error),
        other => python::<WeldpathError>(other),
    }
}

/// Why paths or program are withheld, with the ids of the reasons.
pub(crate) fn withheld(py: Python<'_>, withheld: &Withheld) -> PyErr {
    let (error, ids): (PyErr, Vec<&str>) = match withheld {
        Withheld::Refused(verdict) => (
            python::<Refused>(withheld),
            verdict.reasons.iter().filter(|reason| !reason.accepted).map(|reason| reason.id.name()).collect(),
        ),
        Withheld::Unconfirmed(ids) => {
            let names: Vec<&str> = ids.iter().map(|id| id.name()).collect();
            let way =
                format!("{withheld}: look at each, then name it in confirm=, or in accept= of the plan");
            (python::<Unconfirmed>(way), names)
        }
        other => (python::<WeldpathError>(other), Vec::new()),
    };
    match error.value(py).setattr("reasons", ids) {
        Ok(()) => error,
        Err(other) => other,
    }
}

pub(crate) fn reasons(names: &[String]) -> PyResult<Vec<ReasonId>> {
    names.iter().map(|name| name.parse().map_err(python::<JobError>)).collect()
}

pub(crate) fn robot(name: &str) -> PyResult<Dialect> {
    serde_json::from_value(name.into()).map_err(|_| {
        let known = Dialect::ALL.iter().filter_map(|robot| serde_json::to_value(robot).ok());
        let names: Vec<String> = known.filter_map(|value| value.as_str().map(str::to_owned)).collect();
        python::<JobError>(format!("{name:?} is not a known robot; known are {}", names.join(", ")))
    })
}

pub(crate) fn add(py: Python<'_>, module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("WeldpathError", py.get_type::<WeldpathError>())?;
    module.add("InputError", py.get_type::<InputError>())?;
    module.add("JobError", py.get_type::<JobError>())?;
    module.add("NoSeam", py.get_type::<NoSeam>())?;
    module.add("Refused", py.get_type::<Refused>())?;
    module.add("Unconfirmed", py.get_type::<Unconfirmed>())?;
    module.add("OutputError", py.get_type::<OutputError>())?;
    module.add("InternalError", py.get_type::<InternalError>())
}
