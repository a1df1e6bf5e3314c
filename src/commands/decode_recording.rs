use std::process::ExitCode;

use clap::Args;
use recordings::DecoderProgram;

use crate::process::own_program;

/// As it is typed.
const NAME: &str = "decode-recording";

#[derive(Debug, Args)]
pub struct Arguments {
    /// The import's spec as JSON
    spec: String,
}

/// This program, as the child that a worker has decode a stranger's file.
pub fn program() -> std::io::Result<DecoderProgram> {
    let program = own_program()?;
    Ok(DecoderProgram { program, arguments: vec![NAME.to_owned()] })
}

pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    recordings::decode_standard_input(&arguments.spec)?;
    Ok(ExitCode::SUCCESS)
}
