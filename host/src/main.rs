//! The command `weldpath`: all of it is in the library, which the Python package calls as well.

mod memory;

fn main() -> std::process::ExitCode {
    memory::keep_freed();
    weldpath::cli::start(std::env::args_os()).into()
}
