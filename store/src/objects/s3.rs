//! Objects in a bucket of an S3-compatible store.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use object_store::aws::{AmazonS3, AmazonS3Builder, AmazonS3ConfigKey};
use object_store::prefix::PrefixStore;
use object_store::{BackoffConfig, Certificate, ClientOptions, ObjectStore, RetryConfig};

use super::answers::Answers;
use super::away::{RemoteObjects, Surroundings};
use super::cache::CACHE_LIMIT;
use super::client::{Condition, Connector};
use super::probe::probe;
use super::signed::UrlSigner;
use super::url::ObjectsUrl;
use crate::StoreError;

/// Options of the connection to an object store, with its keys.
#[derive(Clone, Debug)]
pub struct S3Options {
    /// The usual variables: `AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_REGION` and others.
    variables: Vec<(AmazonS3ConfigKey, String)>,
    /// Amazon's own endpoint if `None`.
    endpoint: Option<String>,
    /// A PEM file with certificates to trust besides those of the system.
    ca_bundle: Option<PathBuf>,
    /// How long requests wait for the service.
    pub patience: Patience,
    /// Size limit of the copies on this machine, in bytes.
    pub cache_bytes: u64,
}

/// How long requests are retried if a store does not answer, or answers that it is too busy.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// Time from the first try of a request to the last.
    pub retry_for: Duration,
    /// Time limit for opening a connection.
    pub connect_within: Duration,
    /// Time limit for the next bytes of an answer, and for sending a part.
    pub silence: Duration,
}

impl Patience {
    /// For the first test whether the store is there.
    pub const BRIEF: Self = Self {
        retry_for: Duration::from_secs(3),
        connect_within: Duration::from_secs(3),
        silence: Duration::from_secs(10),
    };
}

impl Default for Patience {
    fn default() -> Self {
        Self {
            retry_for: Duration::from_secs(120),
            connect_within: Duration::from_secs(5),
            silence: Duration::from_secs(60),
        }
    }
}

/// The longest pause before a request is tried again.
const LONGEST_PAUSE: Duration = Duration::from_secs(5);

/// Limit of tries per request. Pauses grow, so `retry_for` ends first.
const TRIES: usize = 100;

impl S3Options {
    /// The options in the environment of this process.
    ///
    /// # Errors
    /// [`StoreError::S3Options`] when the endpoint is not a URL.
    pub fn from_env() -> Result<Self, StoreError> {
        let variables = std::env::vars_os();
        Self::new(variables.filter_map(|(name, value)| {
            Some((name.into_string().ok()?, value.into_string().ok()?))
        }))
    }

    /// The options in `variables`. `TORQUED_S3_ENDPOINT` takes precedence over
    /// `AWS_ENDPOINT_URL_S3` and `AWS_ENDPOINT_URL`.
    ///
    /// # Errors
    /// [`StoreError::S3Options`] when the endpoint is not a URL, or the size of the cache is not a
    /// number.
    pub fn new(variables: impl IntoIterator<Item = (String, String)>) -> Result<Self, StoreError> {
        let mut options = Self {
            variables: Vec::new(),
            endpoint: None,
            ca_bundle: None,
            patience: Patience::default(),
            cache_bytes: CACHE_LIMIT,
        };
        let mut endpoints = [const { None }; ENDPOINTS.len()];
        for (name, value) in variables {
            let value = value.trim();
            if value.is_empty() {
                continue;
            }
            if let Some(place) = ENDPOINTS.iter().position(|endpoint| *endpoint == name) {
                endpoints[place] = Some(checked_endpoint(ENDPOINTS[place], value)?);
            } else if name == CACHE_BYTES {
                options.cache_bytes = value.parse().map_err(|_| StoreError::S3Options {
                    name: CACHE_BYTES,
                    value: value.to_owned(),
                    allowed: "a number of bytes".to_owned(),
                })?;
            } else if name == "AWS_CA_BUNDLE" {
                options.ca_bundle = Some(value.into());
            } else if name.starts_with("AWS_")
                && let Ok(key) = name.to_ascii_lowercase().parse()
                && !is_set_elsewhere(key)
            {
                options.variables.push((key, value.to_owned()));
            }
        }
        options.endpoint = endpoints.into_iter().flatten().next();
        Ok(options)
    }

    /// The endpoint, for messages.
    pub(crate) fn endpoint(&self) -> &str {
        self.endpoint.as_deref().unwrap_or("Amazon S3")
    }

    /// The condition of writes. Set `AWS_CONDITIONAL_PUT=disabled` for stores that refuse
    /// conditions.
    pub(crate) fn condition(&self) -> Condition {
        let disabled = (AmazonS3ConfigKey::ConditionalPut, "disabled".to_owned());
        if self.variables.contains(&disabled) {
            Condition::Unconditional
        } else {
            Condition::NoneThere
        }
    }
}

/// Size limit of all copies together, in bytes. Half of the disk is the limit if that is less.
const CACHE_BYTES: &str = "TORQUED_CACHE_BYTES";

/// The first variable that is set is used.
const ENDPOINTS: [&str; 3] = ["TORQUED_S3_ENDPOINT", "AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL"];

/// Whether an option has no effect here: the URL names the bucket, and the endpoint selects plain
/// HTTP.
const fn is_set_elsewhere(key: AmazonS3ConfigKey) -> bool {
    use AmazonS3ConfigKey::{Bucket, Client, Endpoint, S3Endpoint};
    matches!(key, Bucket | Client(_) | Endpoint | S3Endpoint)
}

fn checked_endpoint(name: &'static str, value: &str) -> Result<String, StoreError> {
    let rest = value.strip_prefix("https://").or_else(|| value.strip_prefix("http://"));
    let host = rest.map(|rest| rest.split('/').next().unwrap_or_default());
    if host.is_none_or(|host| host.is_empty() || host.contains(['@', '?', '#', ' '])) {
        let allowed =
            "`https://HOST[:PORT]`, or `http://HOST[:PORT]` without encryption".to_owned();
        return Err(StoreError::S3Options { name, value: value.to_owned(), allowed });
    }
    Ok(value.trim_end_matches('/').to_owned())
}

impl ObjectsUrl {
    /// Connects to the bucket, after a test that writes, reads and deletes a small object.
    ///
    /// # Errors
    /// [`StoreError::ObjectsUnusable`], in one line that says what to do, when the bucket does not
    /// exist, does not answer or refuses. [`StoreError::S3Options`] when an option cannot be used.
    pub async fn connect(&self, options: &S3Options) -> Result<RemoteObjects, StoreError> {
        probe(self, options, &*self.objects(options, Patience::BRIEF)?.store).await?;
        self.objects(options, options.patience)
    }

    fn objects(
        &self,
        options: &S3Options,
        patience: Patience,
    ) -> Result<RemoteObjects, StoreError> {
        let answers = Answers::default();
        let bucket = self.bucket_store(options, patience, answers.clone())?;
        let signer = UrlSigner { bucket: Arc::new(bucket.clone()), prefix: self.prefix().clone() };
        let prefix = self.prefix().clone();
        let (store, around): (Arc<dyn ObjectStore>, _) = if prefix.as_ref().is_empty() {
            (Arc::new(bucket), None)
        } else {
            let whole = Surroundings { bucket: Arc::new(bucket.clone()), prefix: prefix.clone() };
            (Arc::new(PrefixStore::new(bucket, prefix)), Some(whole))
        };
        let cache_bytes = options.cache_bytes;
        Ok(RemoteObjects { store, answers, cache_bytes, signer: Some(signer), around })
    }

    fn bucket_store(
        &self,
        options: &S3Options,
        patience: Patience,
        answers: Answers,
    ) -> Result<AmazonS3, StoreError> {
        install_tls();
        let mut client = ClientOptions::new()
            .with_timeout_disabled()
            .with_connect_timeout(patience.connect_within)
            .with_read_timeout(patience.silence);
        for certificate in certificates(options)? {
            client = client.with_root_certificate(certificate);
        }
        let retry = RetryConfig {
            backoff: BackoffConfig { max_backoff: LONGEST_PAUSE, ..BackoffConfig::default() },
            max_retries: TRIES,
            retry_timeout: patience.retry_for,
        };
        let mut builder = AmazonS3Builder::new().with_client_options(client).with_retry(retry);
        for (key, value) in &options.variables {
            builder = builder.with_config(*key, value);
        }
        builder = builder.with_bucket_name(self.bucket());
        if let Some(endpoint) = &options.endpoint {
            let is_plain = endpoint.starts_with("http://");
            builder = builder.with_endpoint(endpoint).with_allow_http(is_plain);
        }
        let connector = Connector { condition: options.condition(), answers };
        builder.with_http_connector(connector).build().map_err(|error| {
            StoreError::ObjectsUnusable {
                url: self.to_string(),
                endpoint: options.endpoint().to_owned(),
                reason: error.to_string(),
            }
        })
    }
}

fn certificates(options: &S3Options) -> Result<Vec<Certificate>, StoreError> {
    let Some(path) = &options.ca_bundle else { return Ok(Vec::new()) };
    let refused = |allowed: String| StoreError::S3Options {
        name: "AWS_CA_BUNDLE",
        value: path.display().to_string(),
        allowed,
    };
    let pem = std::fs::read(path).map_err(|error| refused(format!("a file of PEM ({error})")))?;
    let bundle = Certificate::from_pem_bundle(&pem);
    bundle.map_err(|error| refused(format!("certificates in PEM ({error})")))
}

/// Makes `ring` the default crypto provider of TLS in this process.
fn install_tls() {
    // This fails if a default is installed already.
    let _ = rustls::crypto::ring::default_provider().install_default();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(variables: &[(&str, &str)]) -> Result<S3Options, StoreError> {
        let owned = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
        S3Options::new(variables.iter().map(owned))
    }

    #[test]
    fn our_own_variable_goes_before_the_usual_ones() {
        let aws = ("AWS_ENDPOINT_URL", "https://a.example");
        let s3 = ("AWS_ENDPOINT_URL_S3", "https://b.example");
        let own = ("TORQUED_S3_ENDPOINT", "http://127.0.0.1:9000/");
        let none = ("TORQUED_S3_ENDPOINT", "");
        for (variables, endpoint) in [
            (&[][..], "Amazon S3"),
            (&[aws], "https://a.example"),
            (&[s3, aws], "https://b.example"),
            (&[aws, s3, own], "http://127.0.0.1:9000"),
            (&[aws, none], "https://a.example"),
        ] {
            assert_eq!(options(variables).unwrap().endpoint(), endpoint);
        }
    }

    #[test]
    fn an_endpoint_that_is_none_is_refused_with_its_name() {
        for value in ["127.0.0.1:9000", "ftp://a", "https://", "http://key:secret@a"] {
            let error = options(&[("TORQUED_S3_ENDPOINT", value)]).unwrap_err().to_string();
            assert!(error.starts_with(&format!("TORQUED_S3_ENDPOINT is `{value}`")), "{error}");
            assert!(error.contains("https://HOST[:PORT]"), "{error}");
        }
    }

    #[test]
    fn plain_http_is_spoken_where_the_endpoint_says_so() {
        let keys = [("AWS_ACCESS_KEY_ID", "a"), ("AWS_SECRET_ACCESS_KEY", "b")];
        let url: ObjectsUrl = "s3://lab/arm".parse().unwrap();
        for (endpoint, is_allowed) in [("http://a.example", "true"), ("https://a.example", "false")]
        {
            let variables = [&keys[..], &[("AWS_ENDPOINT_URL", endpoint)]].concat();
            let options = options(&variables).unwrap();
            let store = url.bucket_store(&options, Patience::BRIEF, Answers::default()).unwrap();
            let debug = format!("{store:?}");
            assert!(debug.contains(&format!("allow_http: Parsed({is_allowed})")), "{debug}");
        }
    }

    #[test]
    fn half_a_pair_of_keys_is_refused() {
        let url: ObjectsUrl = "s3://lab/arm".parse().unwrap();
        let options = options(&[("AWS_ACCESS_KEY_ID", "a")]).unwrap();
        let error = url.objects(&options, Patience::BRIEF).unwrap_err().to_string();
        assert!(error.contains("s3://lab/arm") && error.contains("SecretAccessKey"), "{error}");
    }
}
