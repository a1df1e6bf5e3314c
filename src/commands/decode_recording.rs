use std::process::ExitCode;

use clap::Args;
use recordings::DecoderProgram;

use crate::process::own_program;

/// The name of the command.
const NAME: &str = "decode-recording";

#[derive(Debug, Args)]
pub struct Arguments {
    /// The import's spec as JSON
    spec: String,
}

/// This program as a worker's child, which decodes a foreign file.
pub fn program() -> std::io::Result<DecoderProgram> {
    let program = own_program()?;
    Ok(DecoderProgram { program, arguments: vec![NAME.to_owned()] })
}

pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    recordings::decode_standard_input(&arguments.spec)?;
    Ok(ExitCode::SUCCESS)
}
