//! The URL of a bucket that holds a store's objects.

use std::fmt;
use std::str::FromStr;

use object_store::path::Path;

use crate::StoreError;

/// A bucket of an S3-compatible store, and the prefix of all objects in it: `s3://BUCKET/PREFIX`, or `s3://BUCKET`.
///
/// A bucket and prefix belong to one database: the sweep deletes every object that has no row
/// there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectsUrl {
    bucket: String,
    /// Without slashes at its ends; may be empty.
    prefix: Path,
}

impl ObjectsUrl {
    /// The name of the bucket.
    pub fn bucket(&self) -> &str {
        &self.bucket
    }

    pub(crate) const fn prefix(&self) -> &Path {
        &self.prefix
    }

    /// Whether objects of one may lie below the other.
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        let lies_in = |inner: &Self, outer: &Self| inner.prefix.prefix_matches(&outer.prefix);
        self.bucket == other.bucket && (lies_in(self, other) || lies_in(other, self))
    }
}

impl FromStr for ObjectsUrl {
    type Err = StoreError;

    fn from_str(url: &str) -> Result<Self, StoreError> {
        let refused = |reason: String| StoreError::ObjectsUrl { url: url.to_owned(), reason };
        let Some(rest) = url.strip_prefix("s3://") else {
            return Err(refused("it does not begin with `s3://`".to_owned()));
        };
        if let Some(refused_part) = rest.find(['?', '#', '@', ' ']) {
            let part = &rest[refused_part..];
            return Err(refused(format!("`{part}` is not a part of a bucket or prefix")));
        }
        let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        if !is_bucket(bucket) {
            let allowed = "3 to 63 of `a-z 0-9 . -`, a letter or digit at both ends";
            return Err(refused(format!("the bucket is `{bucket}`, allowed: {allowed}")));
        }
        let prefix = prefix.trim_end_matches('/');
        let prefix = Path::parse(prefix)
            .map_err(|error| refused(format!("the prefix is `{prefix}`: {error}")))?;
        Ok(Self { bucket: bucket.to_owned(), prefix })
    }
}

/// <https://docs.aws.amazon.com/AmazonS3/latest/userguide/bucketnamingrules.html>
fn is_bucket(name: &str) -> bool {
    let is_plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit();
    let bytes = name.as_bytes();
    (3..=63).contains(&bytes.len())
        && bytes.iter().all(|byte| is_plain(*byte) || matches!(byte, b'.' | b'-'))
        && bytes.first().copied().is_some_and(is_plain)
        && bytes.last().copied().is_some_and(is_plain)
}

impl fmt::Display for ObjectsUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "s3://{}", self.bucket)?;
        if self.prefix.as_ref().is_empty() { Ok(()) } else { write!(f, "/{}", self.prefix) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_url_names_a_bucket_and_perhaps_a_prefix() {
        for (url, bucket, prefix, shown) in [
            ("s3://lab", "lab", "", "s3://lab"),
            ("s3://lab/", "lab", "", "s3://lab"),
            ("s3://lab.data-1/arm", "lab.data-1", "arm", "s3://lab.data-1/arm"),
            ("s3://lab/arm/panda/", "lab", "arm/panda", "s3://lab/arm/panda"),
        ] {
            let parsed: ObjectsUrl = url.parse().unwrap();
            assert_eq!((parsed.bucket(), parsed.prefix().as_ref()), (bucket, prefix));
            assert_eq!(parsed.to_string(), shown);
            assert_eq!(shown.parse::<ObjectsUrl>().unwrap(), parsed);
        }
    }

    #[test]
    fn a_url_that_is_refused_says_why_and_what_is_allowed() {
        for (url, reason) in [
            ("/data/objects", "it does not begin with `s3://`"),
            ("https://lab.s3.amazonaws.com", "it does not begin with `s3://`"),
            ("s3://", "the bucket is ``, allowed: 3 to 63"),
            ("s3://Lab/arm", "the bucket is `Lab`, allowed: 3 to 63"),
            ("s3://lab-/arm", "the bucket is `lab-`, allowed: "),
            ("s3://lab/arm?region=eu", "`?region=eu` is not a part of a bucket or prefix"),
            ("s3://key:secret@lab/arm", "`@lab/arm` is not a part of a bucket or prefix"),
            ("s3://lab/a//b", "the prefix is `a//b`"),
            ("s3://lab/../b", "the prefix is `../b`"),
        ] {
            let error = url.parse::<ObjectsUrl>().unwrap_err().to_string();
            assert!(error.contains(&format!("`{url}`")) && error.contains(reason), "{error}");
            assert!(error.contains("s3://BUCKET/PREFIX"), "{error}");
        }
    }
}
