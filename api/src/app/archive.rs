//! Several files as one tar. Its layout is known before any file is read, so its size is known and
//! any part of it can be sent alone.

use std::io;
use std::ops::Range;
use std::sync::Arc;

use axum::body::Bytes;
use spec::Digest;
use store::StoredObject;
use tar::{EntryType, Header};

/// The block size of a tar. Headers have one block, and each file begins with a new one.
const BLOCK: u64 = 512;

/// Two empty blocks end a tar.
static END: [u8; 1024] = [0; 1024];

/// A file of an archive. Its bytes are not read yet.
#[derive(Clone, Debug)]
pub struct Member {
    pub name: String,
    pub content: Content,
}

/// The source of a file's bytes.
#[derive(Clone, Debug)]
pub enum Content {
    /// In the store. `file` is the file's name in messages.
    Stored { object: StoredObject, file: String },
    /// In memory.
    Made(Bytes),
}

impl Content {
    fn size(&self) -> u64 {
        match self {
            Self::Stored { object, .. } => object.size,
            Self::Made(bytes) => bytes.len() as u64,
        }
    }

    fn sha256(&self) -> Digest {
        match self {
            Self::Stored { object, .. } => object.sha256,
            Self::Made(bytes) => Digest::of(bytes),
        }
    }
}

/// The layout of a tar. Clones share it.
#[derive(Clone, Debug)]
pub struct Archive {
    segments: Arc<Vec<Segment>>,
    pub size: u64,
    /// The digest of everything that the archive is made from. It identifies the archive's bytes.
    pub digest: Digest,
}

/// Bytes of a tar with one source, and their position.
#[derive(Clone, Debug)]
struct Segment {
    start: u64,
    content: Content,
}

impl Archive {
    /// An archive with the files in a folder called `folder`. The same files give the same bytes:
    /// owners are 0, and the time is 1970.
    ///
    /// # Errors
    /// When a name is too long for a tar: 100 bytes after its last slash.
    pub fn new(folder: &str, members: Vec<Member>) -> io::Result<Self> {
        let mut segments = Vec::new();
        let mut size = 0;
        let mut identity = "torqued tar 1\n".to_owned();
        let mut push = |content: Content| {
            let start = size;
            size += content.size();
            segments.push(Segment { start, content });
        };
        for Member { name, content } in members {
            let path = format!("{folder}/{name}");
            let length = content.size();
            identity.push_str(&format!("{path} {length} {}\n", content.sha256()));
            push(Content::Made(Bytes::copy_from_slice(header(&path, length)?.as_bytes())));
            push(content);
            push(zeros(length.next_multiple_of(BLOCK) - length));
        }
        push(Content::Made(Bytes::from_static(&END)));
        let digest = Digest::of(identity.as_bytes());
        Ok(Self { segments: Arc::new(segments), size, digest })
    }

    /// The contents that overlap `part` of the archive, with the overlapping bytes of each.
    pub fn parts(&self, part: Range<u64>) -> impl Iterator<Item = (Content, Range<u64>)> + use<> {
        let first = self.segments.partition_point(|segment| segment.end() <= part.start);
        let segments = Arc::clone(&self.segments);
        (first..segments.len())
            .map(move |index| segments[index].clone())
            .take_while(move |segment| segment.start < part.end)
            .filter(|segment| segment.content.size() > 0)
            .map(move |segment| {
                let begin = part.start.max(segment.start) - segment.start;
                let end = part.end.min(segment.end()) - segment.start;
                (segment.content, begin..end)
            })
    }
}

impl Segment {
    fn end(&self) -> u64 {
        self.start + self.content.size()
    }
}

fn header(path: &str, size: u64) -> io::Result<Header> {
    let mut header = Header::new_ustar();
    header.set_path(path)?;
    header.set_entry_type(EntryType::Regular);
    header.set_size(size);
    header.set_mode(0o644);
    header.set_mtime(0);
    header.set_uid(0);
    header.set_gid(0);
    header.set_cksum();
    Ok(header)
}

/// Zeros, fewer than a block.
fn zeros(count: u64) -> Content {
    let count = usize::try_from(count).unwrap_or(END.len()).min(END.len());
    Content::Made(Bytes::from_static(&END[..count]))
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use proptest::prelude::*;

    use super::*;

    fn archive(files: &[(&str, &[u8])]) -> Archive {
        let member = |(name, bytes): &(&str, &[u8])| Member {
            name: (*name).to_owned(),
            content: Content::Made(Bytes::copy_from_slice(bytes)),
        };
        Archive::new("dataset-3", files.iter().map(member).collect()).unwrap()
    }

    fn bytes(archive: &Archive, part: Range<u64>) -> Vec<u8> {
        let place = |at: u64| usize::try_from(at).unwrap();
        let piece = |(content, range): (Content, Range<u64>)| match content {
            Content::Made(bytes) => bytes[place(range.start)..place(range.end)].to_vec(),
            Content::Stored { .. } => unreachable!("nothing is stored here"),
        };
        archive.parts(part).flat_map(piece).collect()
    }

    #[test]
    fn a_tar_reader_finds_every_file_with_its_bytes() {
        let files: [(&str, &[u8]); 4] =
            [("a.json", b"{}"), ("empty", b""), ("block", &[7; 512]), ("more", &[9; 513])];
        let archive = archive(&files);
        let tar = bytes(&archive, 0..archive.size);
        assert_eq!(tar.len() as u64, archive.size);
        let mut reader = tar::Archive::new(&tar[..]);
        let mut found = Vec::new();
        for entry in reader.entries().unwrap() {
            let mut entry = entry.unwrap();
            let path = entry.path().unwrap().to_str().unwrap().to_owned();
            let mut content = Vec::new();
            entry.read_to_end(&mut content).unwrap();
            assert_eq!((entry.header().mtime().unwrap(), entry.header().uid().unwrap()), (0, 0));
            found.push((path, content));
        }
        let expected = files.map(|(name, bytes)| (format!("dataset-3/{name}"), bytes.to_vec()));
        assert_eq!(found, expected);
    }

    #[test]
    fn another_name_or_byte_is_another_archive() {
        let digest = |files: &[(&str, &[u8])]| archive(files).digest;
        assert_eq!(digest(&[("a", b"x")]), digest(&[("a", b"x")]));
        assert_ne!(digest(&[("a", b"x")]), digest(&[("a", b"y")]));
        assert_ne!(digest(&[("a", b"x")]), digest(&[("b", b"x")]));
    }

    proptest! {
        #[test]
        fn a_part_has_the_bytes_of_the_whole(from in 0_u64..4096, to in 0_u64..4096) {
            let archive = archive(&[("a", &[1; 600]), ("b", b""), ("c", &[2; 100])]);
            let (from, to) = (from.min(archive.size), to.min(archive.size));
            let part = from.min(to)..from.max(to);
            let whole = bytes(&archive, 0..archive.size);
            let place = |at: u64| usize::try_from(at).unwrap();
            let expected = &whole[place(part.start)..place(part.end)];
            prop_assert_eq!(bytes(&archive, part), expected);
        }
    }
}
