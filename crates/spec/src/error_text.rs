//! The text of errors and panics, for people to read.

use std::any::Any;
use std::error::Error;

/// An error and its causes, outermost first.
pub fn causes(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text.push_str(": ");
        text.push_str(&error.to_string());
        cause = error.source();
    }
    text
}

/// The message of a panic that was caught.
pub fn panic_message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic without a message")
}

#[cfg(test)]
mod tests {
    use std::fmt;
    use std::io;
    use std::panic::{catch_unwind, panic_any};

    use super::*;

    #[derive(Debug)]
    struct Outer(io::Error);

    impl fmt::Display for Outer {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("writing a.parquet")
        }
    }

    impl Error for Outer {
        fn source(&self) -> Option<&(dyn Error + 'static)> {
            Some(&self.0)
        }
    }

    #[test]
    fn causes_follow_each_other() {
        assert_eq!(causes(&Outer(io::Error::other("no room"))), "writing a.parquet: no room");
    }

    #[test]
    fn a_panic_says_what_its_message_was_however_it_was_made() {
        let message = |panic: fn()| {
            let panic = catch_unwind(panic).unwrap_err();
            panic_message(panic.as_ref()).to_owned()
        };
        assert_eq!(message(|| panic!("plain")), "plain");
        assert_eq!(message(|| panic!("{} of {}", 1, 2)), "1 of 2");
        assert_eq!(message(|| panic_any(7)), "a panic without a message");
    }
}
