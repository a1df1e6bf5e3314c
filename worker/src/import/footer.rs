//! What a Parquet file says of itself at its end, looked through before a decoder believes it.
//!
//! The decoder builds the tree of columns by recursion and reserves memory for as many children as
//! a column claims; both would end the process, not only the task.

use parquet::file::reader::ChunkReader;

use super::error::ImportError;
use super::thrift::{Thrift, kind};

/// Bytes of a footer, of which the decoder takes a few hundred times as many at worst.
const MAX_FOOTER_BYTES: usize = 8 << 20;

/// Columns and groups of columns in a file.
const MAX_COLUMNS: u64 = 10_000;

/// Groups of columns within each other.
const MAX_DEPTH: usize = 32;

const MAGIC: &[u8] = b"PAR1";

/// The footer's length and the magic bytes.
const TAIL: usize = 8;

/// # Errors
/// When the file has no footer, or one that no writer makes.
pub(super) fn check<R: ChunkReader>(file: &R) -> Result<(), ImportError> {
    let size = file.len();
    let no_parquet = |reason: String| Err(ImportError::file(format!("it is no Parquet: {reason}")));
    if size < (MAGIC.len() + TAIL) as u64 {
        return no_parquet(format!("it has {size} bytes, and none has less than 12"));
    }
    if *file.get_bytes(0, MAGIC.len())? != *MAGIC {
        return no_parquet("it does not begin with PAR1".to_owned());
    }
    let tail = file.get_bytes(size - TAIL as u64, TAIL)?;
    if tail[4..] != *MAGIC {
        return no_parquet("it does not end with PAR1: it was cut off, or encrypted".to_owned());
    }
    let length = u32::from_le_bytes([tail[0], tail[1], tail[2], tail[3]]);
    let room = size - (MAGIC.len() + TAIL) as u64;
    if u64::from(length) > room {
        let reason = format!("its footer claims {length} bytes where {room} are");
        return Err(ImportError::file(reason));
    }
    let length = usize::try_from(length).unwrap_or(usize::MAX);
    if length > MAX_FOOTER_BYTES {
        let reason = format!(
            "its footer has {length} bytes, at most {MAX_FOOTER_BYTES} are read; write it with \
             larger row groups"
        );
        return Err(ImportError::file(reason));
    }
    let footer = file.get_bytes(size - TAIL as u64 - length as u64, length)?;
    check_columns(&footer)
        .unwrap_or_else(|| Err(ImportError::file("its footer is damaged: no Thrift structure")))
}

/// `FileMetaData` of the Parquet format: field 2 is the tree of columns as a list, depth first.
fn check_columns(footer: &[u8]) -> Option<Result<(), ImportError>> {
    const SCHEMA: i16 = 2;
    let mut thrift = Thrift::new(footer);
    let mut last = 0;
    while let Some(field) = thrift.field(last)? {
        last = field.id;
        if field.id == SCHEMA && field.kind == kind::LIST {
            if let Err(reason) = check_tree(&mut thrift)? {
                return Some(Err(ImportError::file(format!("its footer is damaged: {reason}"))));
            }
        } else {
            thrift.skip(field.kind)?;
        }
    }
    Some(Ok(()))
}

/// A list of `SchemaElement`, of which field 5 is the number of children.
fn check_tree(thrift: &mut Thrift<'_>) -> Option<Result<(), String>> {
    let (element, count) = thrift.list()?;
    if element != kind::STRUCT || count > MAX_COLUMNS {
        return Some(Err(format!("{count} columns, allowed are {MAX_COLUMNS}")));
    }
    // Children that are still to come, of every group that is open.
    let mut open: Vec<u64> = Vec::new();
    for left in (0..count).rev() {
        if let Some(siblings) = open.last_mut() {
            *siblings -= 1;
        }
        let children = children(thrift)?;
        let Some(children) = u64::try_from(children).ok().filter(|children| *children <= left)
        else {
            return Some(Err(format!("a column with {children} children where {left} follow")));
        };
        open.push(children);
        while open.last() == Some(&0) {
            open.pop();
        }
        if open.len() > MAX_DEPTH {
            return Some(Err(format!("columns nested more than {MAX_DEPTH} deep")));
        }
        if open.is_empty() && left > 0 {
            return Some(Err("columns outside the root".to_owned()));
        }
    }
    if open.is_empty() { Some(Ok(())) } else { Some(Err("columns are missing".to_owned())) }
}

fn children(thrift: &mut Thrift<'_>) -> Option<i64> {
    const NUM_CHILDREN: i16 = 5;
    let mut children = 0;
    let mut last = 0;
    while let Some(field) = thrift.field(last)? {
        last = field.id;
        if field.id == NUM_CHILDREN {
            children = thrift.integer(field)?;
        } else {
            thrift.skip(field.kind)?;
        }
    }
    Some(children)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A footer with columns that have so many children.
    fn footer(children: &[u8]) -> Vec<u8> {
        let count = u8::try_from(children.len()).unwrap();
        let mut bytes = vec![0x15, 0x04, 0x19, 0xfc, count];
        for children in children {
            bytes.extend([0x48, 0x01, b'c', 0x15, children << 1, 0x00]);
        }
        bytes.push(0x00);
        bytes
    }

    fn verdict(children: &[u8]) -> String {
        match check_columns(&footer(children)) {
            None => "no Thrift".to_owned(),
            Some(Ok(())) => "fine".to_owned(),
            Some(Err(error)) => error.to_string(),
        }
    }

    #[test]
    fn a_tree_of_columns_is_whole() {
        assert_eq!(verdict(&[3, 0, 2, 0, 0, 0]), "fine");
        assert!(verdict(&[3, 0, 0]).contains("3 children where 2 follow"));
        assert!(verdict(&[1, 0, 0]).contains("outside the root"));
        assert!(verdict(&[2, 1, 0]).contains("missing"), "{}", verdict(&[2, 1, 0]));
    }

    #[test]
    fn columns_nested_without_end_are_refused() {
        let mut chain = vec![1; 100];
        chain.push(0);
        assert!(verdict(&chain).contains("nested"));
    }
}
