//! Problems of an object store that refuses or does not answer, and what to do about them.

use std::error::Error;

use object_store::client::{HttpError, HttpErrorKind};

/// Why an object store did not carry a request out, where a person can help.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trouble {
    NoKeys,
    WrongKeys,
    NotPermitted,
    NoBucket,
    OtherRegion,
    UntrustedCertificate,
    WrongClock,
    NoConditions,
    Busy,
    Unreachable,
}

impl Trouble {
    pub fn of(error: &object_store::Error) -> Option<Self> {
        let texts = texts(error);
        // Credentials are requested at these addresses if no variable has them.
        if texts.contains("169.254.169.254") || texts.contains("169.254.170.2") {
            return Some(Self::NoKeys);
        }
        if let Some(trouble) = code(&texts).and_then(Self::of_code) {
            return Some(trouble);
        }
        if texts.contains("certificate") {
            return Some(Self::UntrustedCertificate);
        }
        if texts.contains("incorrectly configured region") {
            return Some(Self::OtherRegion);
        }
        if texts.contains("status code: 5") {
            return Some(Self::Busy);
        }
        match error {
            object_store::Error::PermissionDenied { .. } => Some(Self::NotPermitted),
            object_store::Error::Unauthenticated { .. } => Some(Self::WrongKeys),
            _ => is_transport(error).then_some(Self::Unreachable),
        }
    }

    /// <https://docs.aws.amazon.com/AmazonS3/latest/API/ErrorResponses.html>
    fn of_code(code: &str) -> Option<Self> {
        Some(match code {
            "InvalidAccessKeyId"
            | "SignatureDoesNotMatch"
            | "NotSignedUp"
            | "InvalidToken"
            | "ExpiredToken"
            | "InvalidSecurity" => Self::WrongKeys,
            "AccessDenied" | "AccountProblem" | "AllAccessDisabled" => Self::NotPermitted,
            "NoSuchBucket" => Self::NoBucket,
            "PermanentRedirect"
            | "AuthorizationHeaderMalformed"
            | "IllegalLocationConstraintException" => Self::OtherRegion,
            "RequestTimeTooSkewed" => Self::WrongClock,
            "NotImplemented" => Self::NoConditions,
            "SlowDown" | "ServiceUnavailable" | "InternalError" => Self::Busy,
            _ => return None,
        })
    }

    /// The problem, and what to do.
    pub const fn advice(self) -> &'static str {
        match self {
            Self::NoKeys => "there are no keys; set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY",
            Self::WrongKeys => {
                "the store refuses the keys; set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY to a pair that it knows"
            }
            Self::NotPermitted => {
                "the keys do not permit it; allow them to list the bucket, and to read, write and delete its objects"
            }
            Self::NoBucket => "the bucket does not exist; create it, or correct the URL",
            Self::OtherRegion => "the bucket is in another region; set AWS_REGION to it",
            Self::UntrustedCertificate => {
                "the store's certificate is not trusted; set AWS_CA_BUNDLE to the file with the certificate of its \
                 authority"
            }
            Self::WrongClock => "the clock of this machine differs from the store's; set it",
            Self::NoConditions => {
                "the store cannot create an object only if there is none; set \
                 AWS_CONDITIONAL_PUT=disabled, and give no other database this bucket and prefix"
            }
            Self::Busy => "the store cannot answer now; see its log, and try again",
            Self::Unreachable => {
                "the store does not answer; check that it runs, and that TORQUED_S3_ENDPOINT is \
                 its address"
            }
        }
    }
}

/// Advice for the end of an error message.
pub(crate) fn advice(error: &object_store::Error) -> String {
    Trouble::of(error).map_or(String::new(), |trouble| format!("; {}", trouble.advice()))
}

/// The error without the answer's body, which is XML of many lines.
pub(crate) fn in_short(error: &object_store::Error) -> String {
    let text = error.to_string();
    let said = text.split(['<', '\n']).next().unwrap_or_default().trim_end_matches([':', ' ']);
    match code(&text) {
        Some(code) => format!("{said}: {code}"),
        None => said.to_owned(),
    }
}

fn texts(error: &(dyn Error + 'static)) -> String {
    let mut texts = String::new();
    let mut cause = Some(error);
    while let Some(error) = cause {
        texts.push_str(&error.to_string());
        texts.push('\n');
        cause = error.source();
    }
    texts
}

fn code(texts: &str) -> Option<&str> {
    let (_, rest) = texts.split_once("<Code>")?;
    rest.split_once("</Code>").map(|(code, _)| code)
}

fn is_transport(error: &(dyn Error + 'static)) -> bool {
    use HttpErrorKind::{Connect, Interrupted, Request, Timeout};
    let mut cause = Some(error);
    while let Some(error) = cause {
        if let Some(error) = error.downcast_ref::<HttpError>() {
            return matches!(error.kind(), Connect | Interrupted | Request | Timeout);
        }
        cause = error.source();
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answered(text: &str) -> object_store::Error {
        object_store::Error::Generic { store: "S3", source: text.to_owned().into() }
    }

    #[test]
    fn an_answer_is_told_by_its_code() {
        for (code, trouble) in [
            ("SignatureDoesNotMatch", Some(Trouble::WrongKeys)),
            ("AccessDenied", Some(Trouble::NotPermitted)),
            ("NoSuchBucket", Some(Trouble::NoBucket)),
            ("NoSuchKey", None),
        ] {
            let error = answered(&format!("status: 404: <Error><Code>{code}</Code></Error>"));
            assert_eq!(Trouble::of(&error), trouble);
            assert_eq!(in_short(&error), format!("Generic S3 error: status: 404: {code}"));
        }
        let busy = answered("Server returned non-2xx status code: 503 Service Unavailable: ");
        assert_eq!(Trouble::of(&busy), Some(Trouble::Busy));
        let silent = HttpError::new(HttpErrorKind::Timeout, std::io::Error::other("silence"));
        let silent = object_store::Error::Generic { store: "S3", source: Box::new(silent) };
        assert_eq!(Trouble::of(&silent), Some(Trouble::Unreachable));
    }
}
