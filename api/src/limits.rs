//! Every limit of the server in one place; crossing one is a 4xx or 503 that names it.

use std::time::Duration;

/// Bytes of a request body that is a spec. Crossing it is a 413.
pub const BODY_BYTES: usize = 1 << 20;

/// Items of one page of a list when the request does not say.
pub const PAGE_DEFAULT: u32 = 50;

/// Items of one page of a list at most.
pub const PAGE_MAXIMUM: u32 = 500;

/// Days for which what was deleted can be restored, unless the server is told otherwise.
pub const TRASH_DAYS: u16 = 30;

/// Characters of a text that is looked for.
pub const SEARCH_CHARACTERS: usize = 200;

/// Characters of a name that somebody gives to a thing.
pub const NAME_CHARACTERS: usize = 200;

/// Bytes of a note.
pub const NOTE_BYTES: usize = 10_000;

/// Tags of a thing, and those that a list is asked for at once.
pub const TAGS: usize = store::MAX_TAGS;

/// Characters of a tag.
pub const TAG_CHARACTERS: usize = 64;

/// Chunks of a page of a log, up to 16 KiB each, when the request does not say.
pub const LOGS_DEFAULT: u32 = 50;

/// Chunks of a page of a log at most.
pub const LOGS_MAXIMUM: u32 = 100;

/// Seconds that a request may wait for the next lines of a log, well below [`REQUEST_TIMEOUT`].
pub const LOG_WAIT_SECONDS: u32 = 20;

/// Requests that wait for lines of a log at once; the ones beyond are answered without waiting.
pub const LOG_READERS: usize = 64;

/// Between two looks for the next lines of a log.
pub const LOG_POLL: Duration = Duration::from_millis(300);

/// Trajectories of one simulation, unless the server is told otherwise: a few hundred gigabytes.
/// Crossing it is a violation of `trajectories`.
pub const MAX_TRAJECTORIES: u64 = 10_000_000;

/// Requests that read samples of a dataset at once, each with a row group in memory, up to some
/// 50 MB; others wait for their turn.
pub const TRAJECTORY_READS: usize = 4;

/// Shards that are kept open for reading single trajectories.
pub const OPEN_SHARDS: usize = 16;

/// Points of one metric when the request does not say.
pub const POINTS_DEFAULT: u32 = 500;

/// Points of one metric at most.
pub const POINTS_MAXIMUM: u32 = 5000;

/// Bytes of a file that is sent to be imported, unless the server is told otherwise. Crossing it is
/// a 413.
pub const MAX_UPLOAD_BYTES: u64 = 4 << 30;

/// Files on their way in at once; the ones beyond are refused with 503.
pub const CONCURRENT_UPLOADS: usize = 8;

/// How long a sender may take for the next bytes of a file. Crossing it is a 408.
pub const UPLOAD_STALL: Duration = Duration::from_secs(30);

/// How long a file may take in all, however steadily it comes. Crossing it is a 408.
pub const UPLOAD_TIMEOUT: Duration = Duration::from_secs(6 * 60 * 60);

/// Bytes of the name of a file.
pub const UPLOAD_NAME_BYTES: usize = 200;

/// Bytes of a token's name.
pub const TOKEN_NAME_BYTES: usize = 100;

/// The shortest and the longest time after which a token expires, s.
pub const TOKEN_LIFETIME_S: (u64, u64) = (60, 10 * 365 * 24 * 60 * 60);

/// How long a browser stays logged in.
pub const SESSION_LASTS: Duration = Duration::from_secs(7 * 24 * 60 * 60);

/// Bytes of an `Idempotency-Key`.
pub const IDEMPOTENCY_KEY_BYTES: usize = 255;

/// Bytes of an `X-Request-Id`; another name takes the place of a longer one.
pub const REQUEST_ID_BYTES: usize = 128;

/// Bytes of a question to a model, and of a message on a stream. Crossing it is a 413, or closes the
/// stream with 1009.
pub const QUESTION_BYTES: usize = 8 << 20;

/// Positions of one answer: scenarios x samples x horizon x 7. Crossing it is a violation of
/// `sampling.samples`.
pub const PREDICTED_POSITIONS: usize = 1_000_000;

/// Quantiles of one question.
pub const QUANTILES: usize = 20;

/// Largest magnitude of a torque or position of a question, N·m or rad.
pub const QUESTION_MAGNITUDE: f32 = 1e6;

/// How long an address is good at which a bucket sends a file.
pub const SIGNED_FOR: Duration = Duration::from_secs(15 * 60);

/// Streams open at once; the ones beyond are refused with 503.
pub const STREAMS: usize = 16;

/// How long a client of a stream may take to accept a message. Crossing it closes the stream.
pub const STREAM_WRITE: Duration = Duration::from_secs(5);

/// Messages of a stream that wait while an answer is computed; those beyond stay in the connection.
pub const STREAM_BACKLOG: usize = 64;

/// Bytes of the messages that wait; when they are reached, no further message is read.
pub const STREAM_BACKLOG_BYTES: usize = QUESTION_BYTES;

/// How often a client of a stream is asked whether it is there while none of its messages are read.
pub const STREAM_PROBE: Duration = Duration::from_secs(1);

/// How often a silent client of a stream is asked whether it is there.
pub const STREAM_PING: Duration = Duration::from_secs(15);

/// How long a client may answer nothing. Crossing it closes the stream.
pub const STREAM_SILENCE: Duration = Duration::from_secs(45);

/// Streams of events open at once; the ones beyond are refused with 503.
pub const EVENT_STREAMS: usize = 256;

/// How often a stream of events says that it is there while nothing happens.
pub const EVENT_HEARTBEAT: Duration = Duration::from_secs(15);

/// How long a client is told to wait before it connects again.
pub const EVENT_RETRY: Duration = Duration::from_secs(1);

/// Events that a client may be behind before it has those between read from the database.
pub const EVENT_BACKLOG: usize = 1024;

/// Events that are read from the database at once for a client that goes on from an id.
pub const EVENT_PAGE: u32 = 200;

/// Between two looks for new events, for all clients together; none without a client.
pub const EVENT_POLL: Duration = Duration::from_millis(200);

/// Between two looks at the progress of the jobs that are followed, for all clients together, while nothing else happens.
pub const EVENT_PROGRESS: Duration = Duration::from_secs(1);

/// How often it is asked whether a client may still read. A list of tokens may be 5 s old, so the stream
/// of a token that was revoked ends within 10 s.
pub const EVENT_ACCESS_CHECKED: Duration = Duration::from_secs(5);

/// How long the body of a spec or a question may take to come. Crossing it is a 408. Less than [`REQUEST_TIMEOUT`].
pub const BODY_WITHIN: Duration = Duration::from_secs(20);

/// How long a request may take until its response begins; downloads may then take as long as
/// they need. Crossing it is a 503.
pub const REQUEST_TIMEOUT: Duration = Duration::from_secs(30);

/// Connections open at once, unless the server is told otherwise. The ones beyond wait to be accepted.
pub const CONNECTIONS: usize = 1024;

/// How long a connection may take to send the head of its next request, and so how long one is kept open between two.
/// Crossing it closes the connection.
pub const HEAD_WITHIN: Duration = Duration::from_secs(20);

/// Bytes of the head of a request. Crossing it is a 431.
pub const HEAD_BYTES: usize = 64 << 10;

/// Fields of the head of a request. Crossing it is a 431.
pub const HEAD_FIELDS: usize = 100;

/// How long a client may accept no byte of an answer. Crossing it closes the connection.
pub const WRITE_STALL: Duration = Duration::from_secs(60);

/// Requests per second of one address, unless the server is told otherwise. Crossing it for long is a 429.
pub const REQUESTS_PER_SECOND: u32 = 300;

/// Seconds of an address's requests that may come at once.
pub const BURST_SECONDS: u32 = 10;

/// Files that are sent at once; the ones beyond are refused with 503.
pub const CONCURRENT_DOWNLOADS: usize = 128;

/// Requests answered at once; the ones beyond are refused with 503 instead of piling up.
pub const CONCURRENT_REQUESTS: usize = 512;

/// How long open connections may go on after a shutdown was asked for.
pub const SHUTDOWN_GRACE: Duration = Duration::from_secs(3);
