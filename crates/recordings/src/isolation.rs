//! Isolates the process that decodes a file: no other file, no network, no other process.
//!
//! Two mechanisms of Linux do it, each on its own. seccomp refuses every system call except the few
//! that decoding needs. Landlock refuses to open files, to connect TCP sockets, to reach abstract
//! sockets and to send signals. A refused call returns an error, so a decoder that makes one goes
//! on as if the file did not exist.

use std::fmt;

/// A mechanism that the kernel offers, or not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mechanism {
    /// A filter of system calls.
    Seccomp,
    /// Rules for the file system, sockets and signals.
    Landlock,
}

impl fmt::Display for Mechanism {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Seccomp => "seccomp",
            Self::Landlock => "Landlock",
        })
    }
}

/// The mechanisms that this kernel, or the container around this process, does not offer.
#[must_use]
pub fn missing_mechanisms() -> Vec<Mechanism> {
    let all = [Mechanism::Seccomp, Mechanism::Landlock];
    all.into_iter().filter(|mechanism| !is_offered(*mechanism)).collect()
}

#[cfg(not(target_os = "linux"))]
const fn is_offered(_: Mechanism) -> bool {
    false
}

#[cfg(target_os = "linux")]
fn is_offered(mechanism: Mechanism) -> bool {
    match mechanism {
        Mechanism::Landlock => {
            /// Asks for the version instead of making a ruleset.
            const VERSION: libc::c_long = 1;
            let none: libc::c_long = 0;
            // SAFETY: with this flag the call takes no pointer and returns a number.
            let version =
                unsafe { libc::syscall(libc::SYS_landlock_create_ruleset, none, none, VERSION) };
            version > 0
        }
        Mechanism::Seccomp => {
            let action: u32 = libc::SECCOMP_RET_ERRNO;
            let ask = libc::c_long::from(libc::SECCOMP_GET_ACTION_AVAIL);
            let none: libc::c_long = 0;
            // SAFETY: the pointer is to a value that lives through the call, and is not kept.
            unsafe { libc::syscall(libc::SYS_seccomp, ask, none, &raw const action) == 0 }
        }
    }
}

/// Isolates this process with all of its threads, for ever, as far as the kernel can.
///
/// Returns why a mechanism could not be used.
#[cfg(target_os = "linux")]
pub(crate) fn isolate() -> Vec<(Mechanism, String)> {
    close_inherited_files();
    // Landlock first, because the filter refuses its calls.
    let attempts =
        [(Mechanism::Landlock, landlock::restrict()), (Mechanism::Seccomp, seccomp::restrict())];
    let failed = attempts
        .into_iter()
        .filter_map(|(mechanism, result)| result.err().map(|reason| (mechanism, reason)));
    failed.collect()
}

#[cfg(not(target_os = "linux"))]
pub(crate) fn isolate() -> Vec<(Mechanism, String)> {
    let reason = "this operating system has none".to_owned();
    vec![(Mechanism::Seccomp, reason)]
}

/// Closes files of the parent. It opens all of them to be closed, and this does not depend on it.
#[cfg(target_os = "linux")]
fn close_inherited_files() {
    const FIRST: libc::c_long = 3;
    const LAST: libc::c_long = u32::MAX as libc::c_long;
    let no_flags: libc::c_long = 0;
    // SAFETY: this process has opened none of these files. An old kernel refuses the call.
    unsafe { libc::syscall(libc::SYS_close_range, FIRST, LAST, no_flags) };
}

#[cfg(target_os = "linux")]
mod landlock {
    use ::landlock::{
        ABI, Access, AccessFs, AccessNet, CompatLevel, Compatible, Ruleset, RulesetAttr,
        RulesetError, RulesetStatus, Scope,
    };

    /// The newest version whose rights are handled. Older kernels handle fewer.
    const NEWEST: ABI = ABI::V6;

    pub fn restrict() -> Result<(), String> {
        match enforce() {
            Ok(RulesetStatus::NotEnforced) => Err("the kernel does not offer it".to_owned()),
            Ok(_) => Ok(()),
            Err(error) => Err(spec::causes(&error)),
        }
    }

    /// Handles all rights and grants none.
    fn enforce() -> Result<RulesetStatus, RulesetError> {
        let status = Ruleset::default()
            .set_compatibility(CompatLevel::BestEffort)
            .handle_access(AccessFs::from_all(NEWEST))?
            .handle_access(AccessNet::from_all(NEWEST))?
            .scope(Scope::from_all(NEWEST))?
            .create()?
            .restrict_self()?;
        Ok(status.ruleset)
    }
}

#[cfg(target_os = "linux")]
mod seccomp {
    use std::collections::BTreeMap;

    use seccompiler::{
        BackendError, BpfProgram, SeccompAction, SeccompCmpArgLen, SeccompCmpOp, SeccompCondition,
        SeccompFilter, SeccompRule,
    };

    /// Calls that decoding makes, with any arguments: reading and writing open files, memory,
    /// random numbers, the clock, and ending.
    const CALLS: [libc::c_long; 25] = [
        libc::SYS_read,
        libc::SYS_readv,
        libc::SYS_pread64,
        libc::SYS_lseek,
        libc::SYS_write,
        libc::SYS_writev,
        libc::SYS_close,
        libc::SYS_brk,
        libc::SYS_munmap,
        libc::SYS_mremap,
        libc::SYS_madvise,
        libc::SYS_futex,
        libc::SYS_getrandom,
        libc::SYS_clock_gettime,
        libc::SYS_sched_yield,
        libc::SYS_sched_getaffinity,
        libc::SYS_getpid,
        libc::SYS_gettid,
        libc::SYS_rt_sigprocmask,
        libc::SYS_rt_sigaction,
        libc::SYS_rt_sigreturn,
        libc::SYS_sigaltstack,
        libc::SYS_restart_syscall,
        libc::SYS_exit,
        libc::SYS_exit_group,
    ];

    /// The filter for this process.
    pub fn restrict() -> Result<(), String> {
        let program = program().map_err(|error| spec::causes(&error))?;
        seccompiler::apply_filter_all_threads(&program).map_err(|error| spec::causes(&error))
    }

    fn program() -> Result<BpfProgram, BackendError> {
        let mut rules: BTreeMap<i64, Vec<SeccompRule>> =
            CALLS.into_iter().map(|call| (call, Vec::new())).collect();
        let own_process = u64::from(std::process::id());
        let duplicate = u64::from(libc::F_DUPFD_CLOEXEC.unsigned_abs());
        let executable = u64::from(libc::PROT_EXEC.unsigned_abs());
        let limited = [
            // The limits of this process, and not those of another one.
            (libc::SYS_prlimit64, condition(0, SeccompCmpOp::Eq, 0)?),
            // `abort`.
            (libc::SYS_tgkill, condition(0, SeccompCmpOp::Eq, own_process)?),
            // A second descriptor of the file.
            (libc::SYS_fcntl, condition(1, SeccompCmpOp::Eq, duplicate)?),
            // No memory of new instructions.
            (libc::SYS_mmap, condition(2, SeccompCmpOp::MaskedEq(executable), 0)?),
            (libc::SYS_mprotect, condition(2, SeccompCmpOp::MaskedEq(executable), 0)?),
        ];
        for (call, condition) in limited {
            rules.insert(call, vec![SeccompRule::new(vec![condition])?]);
        }
        let refused = SeccompAction::Errno(libc::EPERM.unsigned_abs());
        let architecture = std::env::consts::ARCH.try_into()?;
        SeccompFilter::new(rules, refused, SeccompAction::Allow, architecture)?.try_into()
    }

    fn condition(
        argument: u8,
        operator: SeccompCmpOp,
        value: u64,
    ) -> Result<SeccompCondition, BackendError> {
        SeccompCondition::new(argument, SeccompCmpArgLen::Dword, operator, value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The machines that test this have both. A test that cannot isolate shows nothing.
    #[test]
    fn this_kernel_offers_both_mechanisms() {
        assert_eq!(missing_mechanisms(), []);
    }
}
