//! The exit codes of the program, so that a script knows what happened.

/// The command line or the configuration file is wrong.
pub const USAGE: u8 = 2;

/// The job that was waited for failed or was cancelled.
pub const JOB_FAILED: u8 = 3;

/// No server answered.
pub const UNREACHABLE: u8 = 4;

/// Shells use this code for a program that Ctrl-C ended.
pub const INTERRUPTED: u8 = 130;

/// The codes in `--help` and in the manual. docs/commands.md says more.
pub const HELP: &str = "\
Exit codes:
  0    done
  1    failed, or refused by the server
  2    the command line or the configuration file is wrong
  3    the job that was waited for failed or was cancelled
  4    no server answered
  130  interrupted by Ctrl-C
  141  nobody read the output any more";

/// An error and its causes, in one line.
pub fn message(error: &anyhow::Error) -> String {
    let mut message = String::new();
    for cause in error.chain().map(ToString::to_string) {
        // Many errors contain their cause already.
        if message.ends_with(&cause) {
            continue;
        }
        if !message.is_empty() {
            message.push_str(": ");
        }
        message.push_str(&cause);
    }
    message
}
