//! `skein verify`: repeats an input log and says whether every output was the same.

use super::Ending;
use crate::verify::{VerifyError, verify};
use std::path::PathBuf;

#[derive(clap::Args)]
pub(super) struct VerifyArgs {
    /// An input log (.mcap) written by `skein run`.
    log: PathBuf,
}

pub(super) fn run(args: &VerifyArgs) -> miette::Result<Ending> {
    match verify(&args.log) {
        Ok(verified) => {
            println!(
                "{}: {} inputs in {:.1} s, {} outputs, all equal bit by bit{}",
                verified.vehicle,
                verified.inputs,
                verified.duration_ns as f64 * 1e-9,
                verified.outputs,
                if verified.ended {
                    ""
                } else {
                    "; the log was cut short (the process was killed, or the disk was full)"
                }
            );
            Ok(Ending::Done)
        }
        Err(error @ VerifyError::Difference { .. }) => {
            eprintln!("{:?}", miette::Report::new(error));
            Ok(Ending::Differs)
        }
        Err(error) => Err(error.into()),
    }
}
