//! The command line of rhinoplan. Everything is in the library.

fn main() -> std::process::ExitCode {
    rhinoplan::cli::main()
}
