//! Behaviour across packages; the tests themselves are in `tests/tests/`, what several of them need is here.

pub mod plans;
pub mod urscript;
