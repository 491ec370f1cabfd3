#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| weldpath_fuzz::arrays(bytes));
