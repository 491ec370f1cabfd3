//! Behaviour across packages; the tests themselves are in `tests/tests/`.
