//! The program `skein`.

fn main() -> std::process::ExitCode {
    skein_agent::command::main()
}
