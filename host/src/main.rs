//! The command `weldpath`. Each subcommand is one file in `cli/`; all they do is in the library.

mod cli;

fn main() -> std::process::ExitCode {
    cli::start()
}
