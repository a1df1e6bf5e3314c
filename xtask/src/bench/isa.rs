//! Measures the smaller instruction sets of a machine.

use std::process::{Command, ExitCode};

use anyhow::Context;
use simd::InstructionSet;

/// Variables that restrict PyTorch, its libraries and NumPy to AVX2. Pinocchio is compiled for it,
/// see [`crate::peers::cxx_flags`].
const PEERS_ON_AVX2: [(&str, &str); 4] = [
    ("ATEN_CPU_CAPABILITY", "avx2"),
    ("MKL_ENABLE_INSTRUCTIONS", "AVX2"),
    ("ONEDNN_MAX_CPU_ISA", "AVX2"),
    ("OPENBLAS_CORETYPE", "Haswell"),
];

/// Runs this command again with these instructions for all programs that it starts, unless they are
/// set already.
pub(super) fn again(instructions: InstructionSet) -> anyhow::Result<Option<ExitCode>> {
    if InstructionSet::chosen()? == instructions {
        return Ok(None);
    }
    let mut command = Command::new(std::env::current_exe()?);
    command.args(std::env::args_os().skip(1));
    command.env(simd::VARIABLE, instructions.to_string());
    if is_avx2(instructions) {
        command.envs(PEERS_ON_AVX2);
    }
    let status = command.status().context("cannot run this command again")?;
    let code = status.code().and_then(|code| u8::try_from(code).ok());
    Ok(Some(code.map_or(ExitCode::FAILURE, ExitCode::from)))
}

/// A bound of a measurement: the first value with AVX-512, the second without.
pub(super) fn bound(avx512: f64, less: f64) -> f64 {
    if InstructionSet::best().to_string() == "AVX-512" { avx512 } else { less }
}

/// Whether AVX2 is measured, on a processor with or without more.
pub(crate) fn is_avx2(instructions: InstructionSet) -> bool {
    instructions.to_string() == "AVX2"
}
