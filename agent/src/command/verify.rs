//! `skein verify`: repeats an input log and says whether every output was the same.

use super::Ending;
use super::output::print;
use crate::verify::{VerifyError, verify};
use std::path::PathBuf;

#[derive(clap::Args)]
#[command(after_help = "Example:
  skein verify logs/v1.mcap
It ends with 4 when something came out differently.")]
pub(super) struct VerifyArgs {
    /// An input log (.mcap) written by `skein run`.
    log: PathBuf,
}

pub(super) fn run(args: &VerifyArgs) -> miette::Result<Ending> {
    match verify(&args.log) {
        Ok(verified) => print(&format!(
            "{}: {} inputs in {:.1} s, {} outputs, all equal bit by bit{}\n",
            verified.vehicle,
            verified.inputs,
            verified.duration_ns as f64 * 1e-9,
            verified.outputs,
            if verified.ended {
                ""
            } else {
                "; the log was cut short (the process was killed, or the disk was full)"
            }
        )),
        Err(error @ VerifyError::Difference { .. }) => {
            eprintln!("{:?}", miette::Report::new(error));
            Ok(Ending::Differs)
        }
        Err(error) => Err(error.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_that_is_not_repeated_ends_it_with_4() {
        let log = crate::verify::tests::spoilt("command");
        let ending = run(&VerifyArgs { log: log.clone() }).unwrap();
        assert_eq!(ending.code(), 4);
        std::fs::remove_file(log).unwrap();
    }
}
