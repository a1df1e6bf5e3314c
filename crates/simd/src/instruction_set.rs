//! The choice of a processor's instructions.

use std::fmt;
use std::str::FromStr;
use std::sync::OnceLock;

/// The vector instructions that kernels use. A value exists only where the processor has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstructionSet {
    /// AVX-512 F, DQ and VL, with everything in [`InstructionSet::Avx2`].
    #[cfg(target_arch = "x86_64")]
    Avx512(Detected),
    /// AVX2 with fused multiply-adds.
    #[cfg(target_arch = "x86_64")]
    Avx2(Detected),
    /// The instructions that every processor of the architecture has.
    Portable,
}

/// Shows that the processor was checked. Only this crate can make one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Detected(());

/// The environment variable that names the instruction set to use in place of the fastest.
pub const VARIABLE: &str = "TORQUED_INSTRUCTIONS";

impl InstructionSet {
    /// The set that [`VARIABLE`] names, or the fastest where it is not set.
    ///
    /// # Errors
    /// This processor has no set of that name.
    pub fn chosen() -> Result<Self, UnknownInstructionSet> {
        static CHOSEN: OnceLock<Result<InstructionSet, UnknownInstructionSet>> = OnceLock::new();
        let chosen = CHOSEN.get_or_init(|| match std::env::var_os(VARIABLE) {
            Some(name) => name.to_string_lossy().parse(),
            None => Ok(Self::fastest()),
        });
        chosen.clone()
    }

    /// The set to use: [`InstructionSet::chosen`], or the fastest if that fails.
    #[inline]
    pub fn best() -> Self {
        static BEST: OnceLock<InstructionSet> = OnceLock::new();
        *BEST.get_or_init(|| Self::chosen().unwrap_or_else(|_| Self::fastest()))
    }

    /// The fastest set of this processor.
    fn fastest() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if let Some(avx512) = Self::avx512() {
                return avx512;
            }
            if let Some(avx2) = Self::avx2() {
                return avx2;
            }
        }
        Self::Portable
    }

    /// The sets of this processor, the fastest first. The last one runs on every processor.
    pub fn available() -> Vec<Self> {
        #[cfg(target_arch = "x86_64")]
        let wide = [Self::avx512(), Self::avx2()];
        #[cfg(not(target_arch = "x86_64"))]
        let wide = [None];
        wide.into_iter().flatten().chain([Self::Portable]).collect()
    }

    /// Whether this is AVX-512 on a processor that also multiplies pairs of bf16 (AVX-512 BF16).
    #[inline]
    pub fn multiplies_bf16(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(_) => {
                is_x86_feature_detected!("avx512bf16") && is_x86_feature_detected!("avx512bw")
            }
            _ => false,
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn avx512() -> Option<Self> {
        let detected = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
            && Self::avx2().is_some();
        detected.then_some(Self::Avx512(Detected(())))
    }

    #[cfg(target_arch = "x86_64")]
    fn avx2() -> Option<Self> {
        let detected = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
        detected.then_some(Self::Avx2(Detected(())))
    }
}

impl fmt::Display for InstructionSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(_) => "AVX-512",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(_) => "AVX2",
            Self::Portable => "portable",
        })
    }
}

/// A name that is not one of this processor's instruction sets.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownInstructionSet(String);

impl fmt::Display for UnknownInstructionSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let available: Vec<String> =
            InstructionSet::available().iter().map(InstructionSet::to_string).collect();
        write!(f, "instruction set {:?}: this processor has {}", self.0, available.join(", "))
    }
}

impl std::error::Error for UnknownInstructionSet {}

impl FromStr for InstructionSet {
    type Err = UnknownInstructionSet;

    /// The set of this processor with this display name, in any case, with or without its hyphen.
    fn from_str(name: &str) -> Result<Self, UnknownInstructionSet> {
        let plain = |name: &str| name.replace('-', "").to_lowercase();
        let mut available = Self::available().into_iter();
        available
            .find(|set| plain(&set.to_string()) == plain(name))
            .ok_or_else(|| UnknownInstructionSet(name.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::InstructionSet;

    #[test]
    fn the_best_set_comes_first_and_the_portable_one_last() {
        let available = InstructionSet::available();
        assert_eq!(available.first(), Some(&InstructionSet::fastest()));
        assert_eq!(available.last(), Some(&InstructionSet::Portable));
    }

    #[test]
    fn a_set_is_parsed_from_what_it_displays() {
        for set in InstructionSet::available() {
            assert_eq!(set.to_string().parse(), Ok(set));
            assert_eq!(set.to_string().to_lowercase().parse(), Ok(set));
            assert_eq!(set.to_string().replace('-', "").parse(), Ok(set));
        }
        let error = "SSE9".parse::<InstructionSet>().map_err(|error| error.to_string());
        assert!(error.is_err_and(|error| error.contains("SSE9") && error.contains("portable")));
    }
}
