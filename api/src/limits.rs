//! The limits of the server, all in one place. Exceeding one gives a 4xx or 503 that names it.

use std::time::Duration;

/// Bytes of a spec as a request body. Exceeding it gives a 413.
pub const BODY_BYTES: usize = 1 << 20;

/// Bytes of a body that is checked at once, on a thread of the runtime. It takes a few milliseconds.
pub const BRIEF_BODY_BYTES: usize = 16 << 10;

/// Larger bodies that are checked at the same time. Further ones wait for their turn. By the sizes of
/// types a check takes at most 200 MiB for [`BODY_BYTES`], and 500 MiB for [`QUESTION_BYTES`].
pub const CONCURRENT_CHECKS: usize = 4;

/// Default number of items on a page of a list.
pub const PAGE_DEFAULT: u32 = 50;

/// Largest number of items on a page of a list.
pub const PAGE_MAXIMUM: u32 = 500;

/// Bytes of JSON of the items on a page of a list. A page with more ends early, after one item at
/// least.
pub const PAGE_BYTES: usize = 16 << 20;

/// Default number of days for which deleted things can be restored.
pub const TRASH_DAYS: u16 = 30;

/// Characters of a search text.
pub const SEARCH_CHARACTERS: usize = 200;

/// Characters of a name that users give to a thing.
pub const NAME_CHARACTERS: usize = 200;

/// Bytes of a note.
pub const NOTE_BYTES: usize = 10_000;

/// Tags of a thing, and tags in one query of a list.
pub const TAGS: usize = store::MAX_TAGS;

/// Characters of a tag.
pub const TAG_CHARACTERS: usize = 64;

/// Default number of chunks, up to 16 KiB each, on a page of a log.
pub const LOGS_DEFAULT: u32 = 50;

/// Largest number of chunks on a page of a log.
pub const LOGS_MAXIMUM: u32 = 100;

/// Seconds that a request may wait for the next lines of a log, well below [`REQUEST_TIMEOUT`].
pub const LOG_WAIT_SECONDS: u32 = 20;

/// Concurrent requests that wait for lines of a log. Further ones are answered without waiting.
pub const LOG_READERS: usize = 64;

/// Pause between two looks for the next lines of a log.
pub const LOG_POLL: Duration = Duration::from_millis(300);

/// Checkpoints whose predictions of a stored trajectory are shown beside each other.
pub const PREDICTED_CHECKPOINTS: usize = 6;

/// Samples of a stored trajectory's prediction that are told and drawn, of each checkpoint. Quantiles
/// are those of all samples.
pub const SHOWN_SAMPLES: usize = 4;

/// Predictions of stored trajectories that are remembered.
pub const REMEMBERED_PREDICTIONS: usize = 256;

/// Positions in all remembered predictions, which are about 30 MB.
pub const REMEMBERED_POSITIONS: usize = 4_000_000;

/// Columns that a reader adds to a list on the page. Further ones are left out.
pub const LISTED_COLUMNS: usize = 12;

/// Items of a list in a file of the page. Further ones are left out.
pub const EXPORTED_ITEMS: usize = 10_000;

/// Points of such a run's metric that its page draws, the first ones.
pub const LOGGED_POINTS: u32 = 100_000;

/// Default limit of a simulation's trajectories: a few hundred gigabytes. Exceeding it is a
/// violation of `trajectories`.
pub const MAX_TRAJECTORIES: u64 = 10_000_000;

/// Concurrent requests that read samples of a dataset. Each has a row group in memory, up to about
/// 50 MB. Further ones wait for their turn.
pub const TRAJECTORY_READS: usize = 4;

/// Number of shards that are kept open for reading single trajectories.
pub const OPEN_SHARDS: usize = 16;

/// Default number of points of a metric.
pub const POINTS_DEFAULT: u32 = 500;

/// Largest number of points of a metric.
pub const POINTS_MAXIMUM: u32 = 5000;

/// Default limit of the bytes of a file that is sent for an import. Exceeding it gives a 413.
pub const MAX_UPLOAD_BYTES: u64 = 4 << 30;

/// Files that are received at once. Further ones are refused with 503.
pub const CONCURRENT_UPLOADS: usize = 8;

/// How long a sender may take for the next bytes of a file. Exceeding it gives a 408.
pub const UPLOAD_STALL: Duration = Duration::from_secs(30);

/// How long a whole file may take. Exceeding it gives a 408.
pub const UPLOAD_TIMEOUT: Duration = Duration::from_secs(6 * 60 * 60);

/// Bytes of a file's name.
pub const UPLOAD_NAME_BYTES: usize = 200;

/// Bytes of a token's name.
pub const TOKEN_NAME_BYTES: usize = 100;

/// The shortest and the longest lifetime of a token, s.
pub const TOKEN_LIFETIME_S: (u64, u64) = (60, 10 * 365 * 24 * 60 * 60);

/// How long a browser stays logged in.
pub const SESSION_LASTS: Duration = Duration::from_secs(7 * 24 * 60 * 60);

/// Bytes of an `Idempotency-Key`.
pub const IDEMPOTENCY_KEY_BYTES: usize = 255;

/// Bytes of an `X-Request-Id`. A longer one is replaced.
pub const REQUEST_ID_BYTES: usize = 128;

/// Bytes of a prediction request, and of a message on a stream. Exceeding it gives a 413, or closes
/// the stream with 1009.
pub const QUESTION_BYTES: usize = 8 << 20;

/// Memory of all questions that are received, wait or are answered. Further ones are refused with
/// 503.
pub const QUESTIONS_MEMORY_BYTES: usize = 1 << 30;

/// Positions of one answer: scenarios x samples x horizon x joints. Exceeding it is a violation of
/// `sampling.samples`.
pub const PREDICTED_POSITIONS: usize = 1_000_000;

/// Torques and positions of one question, with a context for each of its futures. Exceeding it is a
/// violation of `scenarios`.
pub const ASKED_NUMBERS: usize = 20_000_000;

/// Positions in one answer, with those of its quantiles and returned samples. Each takes up to 15
/// bytes. Exceeding it is a violation of `sampling`.
pub const ANSWERED_NUMBERS: usize = 2_000_000;

/// Runs on a page that compares them: the curves that a figure can have.
pub const COMPARED_RUNS: usize = figures::SERIES_ALLOWED;

/// Instants of one motion whose torques are asked for.
pub const MOTION_INSTANTS: usize = 1000;

/// Scenarios of one question for torques.
pub const TORQUE_SCENARIOS: usize = 64;

/// Quantiles of one prediction request.
pub const QUANTILES: usize = 20;

/// Largest magnitude of a torque or position in a prediction request, N·m or rad.
pub const QUESTION_MAGNITUDE: f32 = 1e6;

/// How long a URL is valid at which a bucket sends a file.
pub const SIGNED_FOR: Duration = Duration::from_secs(15 * 60);

/// Prediction streams that are open at once. Further ones are refused with 503.
pub const STREAMS: usize = 16;

/// How long a client of a stream may take to accept a message. Exceeding it closes the stream.
pub const STREAM_WRITE: Duration = Duration::from_secs(5);

/// Messages of a stream that wait while an answer is computed. Further ones stay in the connection.
pub const STREAM_BACKLOG: usize = 64;

/// Bytes of waiting messages. At this number no further message is read.
pub const STREAM_BACKLOG_BYTES: usize = QUESTION_BYTES;

/// How often a stream checks that its client is there while it reads none of its messages.
pub const STREAM_PROBE: Duration = Duration::from_secs(1);

/// How often a stream checks that a silent client is there.
pub const STREAM_PING: Duration = Duration::from_secs(15);

/// How long a client may answer nothing. Exceeding it closes the stream.
pub const STREAM_SILENCE: Duration = Duration::from_secs(45);

/// Streams of events that are open at once, and at most a quarter of the connections. Further ones
/// are refused with 503.
pub const EVENT_STREAMS: usize = 256;

/// How often a silent stream of events sends a sign of life.
pub const EVENT_HEARTBEAT: Duration = Duration::from_secs(15);

/// How long clients are told to wait before they connect again.
pub const EVENT_RETRY: Duration = Duration::from_secs(1);

/// Number of events that a client may be behind before it gets them from the database.
pub const EVENT_BACKLOG: usize = 1024;

/// Number of events that are read from the database at once, for a client that continues from an
/// id.
pub const EVENT_PAGE: u32 = 200;

/// Pause between two looks for new events, for all clients together. There are no looks without a
/// client.
pub const EVENT_POLL: Duration = Duration::from_millis(200);

/// Pause between two looks at the progress of followed jobs, for all clients together, while
/// nothing else happens.
pub const EVENT_PROGRESS: Duration = Duration::from_secs(1);

/// How often a stream checks that its client may still read. A list of tokens may be 5 s old, so
/// the stream of a revoked token ends within 10 s.
pub const EVENT_ACCESS_CHECKED: Duration = Duration::from_secs(5);

/// How long the body of a spec or a prediction request may take to arrive. Exceeding it gives a
/// 408. It is less than [`REQUEST_TIMEOUT`].
pub const BODY_WITHIN: Duration = Duration::from_secs(20);

/// How long a request may take until its response begins. Downloads may then take as long as they
/// need. Exceeding it gives a 503.
pub const REQUEST_TIMEOUT: Duration = Duration::from_secs(30);

/// Default limit of open connections. Further ones wait to be accepted.
pub const CONNECTIONS: usize = 1024;

/// How long a connection may take to send the head of its next request. This is also how long it
/// stays open between two requests. Exceeding it closes the connection.
pub const HEAD_WITHIN: Duration = Duration::from_secs(20);

/// Bytes of the head of a request. Exceeding it gives a 431.
pub const HEAD_BYTES: usize = 64 << 10;

/// Fields of the head of a request. Exceeding it gives a 431.
pub const HEAD_FIELDS: usize = 100;

/// How long a client may accept no byte of an answer. Exceeding it closes the connection.
pub const WRITE_STALL: Duration = Duration::from_secs(60);

/// Bytes of a form of the page, with its characters encoded. Exceeding it gives a 413.
pub const FORM_BYTES: usize = 64 << 10;

/// Bytes of the form that submits a spec, with its characters encoded. Exceeding it gives a 413.
pub const SPEC_FORM_BYTES: usize = 3 * BODY_BYTES;

/// Bytes of the login's form. Anybody may send it. Exceeding it gives a 413.
pub const LOGIN_BYTES: usize = 16 << 10;

/// Characters of a token that the server is started with. A shorter one can be guessed.
pub const TOKEN_CHARACTERS: usize = 16;

/// Default limit of failed logins and wrong tokens from one address, per minute and at once.
/// Exceeding it gives a 429.
pub const FAILED_LOGINS_PER_MINUTE: u32 = 10;

/// Largest number of connections of one address: a quarter of all.
pub fn share_of_connections(connections: usize) -> usize {
    (connections / 4).max(1)
}

/// Default limit of requests per second from one address. Exceeding it for long gives a 429.
pub const REQUESTS_PER_SECOND: u32 = 300;

/// Number of seconds whose requests an address may send at once.
pub const BURST_SECONDS: u32 = 10;

/// Files that are sent at once, and at most an eighth of the connections. Further ones are refused
/// with 503.
pub const CONCURRENT_DOWNLOADS: usize = 128;

/// Requests that are answered at once, and at most half of the connections. Half of them are for
/// one address. Further ones are refused with 503 instead of piling up.
pub const CONCURRENT_REQUESTS: usize = 512;

/// Logins that are answered at once, and at most a sixteenth of the connections.
pub const CONCURRENT_LOGINS: usize = 64;

/// Requests for health, readiness and metrics that are answered at once, and at most a thirty-second
/// of the connections. No other request takes their places.
pub const CONCURRENT_PROBES: usize = 16;

/// Places for administrators, and at most a thirty-second of the connections, when
/// [`CONCURRENT_REQUESTS`] are answered.
pub const ADMIN_REQUESTS: usize = 32;

/// How long open connections may continue after a shutdown was requested.
pub const SHUTDOWN_GRACE: Duration = Duration::from_secs(3);
