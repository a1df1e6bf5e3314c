//! The pages of a column, found by their headers before any of them is decoded.
//!
//! The decoder reserves what a header claims. A header that claims too much is refused here, with
//! the place where it lies; what one column may take is what [`check`] returns.

use parquet::basic::Compression;
use parquet::file::metadata::ColumnChunkMetaData;
use parquet::file::reader::ChunkReader;

use super::error::ImportError;
use super::thrift::{Field, Thrift, kind};

/// Bytes of a page header: a few dozen, and statistics.
const MAX_HEADER_BYTES: u64 = 64 * 1024;

/// Enough for nearly all headers.
const USUAL_HEADER_BYTES: u64 = 512;

/// Codes of the Parquet format.
const DATA_PAGE: i64 = 0;
const DICTIONARY_PAGE: i64 = 2;
const DATA_PAGE_V2: i64 = 3;
const PLAIN: i64 = 0;
const PLAIN_DICTIONARY: i64 = 2;
const DELTA_BINARY_PACKED: i64 = 5;
const DELTA_LENGTH_BYTE_ARRAY: i64 = 6;
const RLE_DICTIONARY: i64 = 8;
const BYTE_STREAM_SPLIT: i64 = 9;

/// `PageHeader` of the Parquet format, as far as it decides over memory.
#[derive(Debug, Default, PartialEq, Eq)]
struct PageHeader {
    page_type: i64,
    uncompressed: i64,
    compressed: i64,
    values: i64,
    encoding: i64,
}

/// Checks the pages of a flat column in a row group of `rows` rows.
///
/// Returns the bytes that decoding it may take at once.
///
/// # Errors
/// When pages lie outside the file, hold other values than `rows`, or are written in a way that
/// could claim memory without limit.
pub(super) fn check<R: ChunkReader>(
    file: &R,
    chunk: &ColumnChunkMetaData,
    rows: u64,
) -> Result<u64, ImportError> {
    check_codec(chunk.compression()).map_err(ImportError::file)?;
    let range = byte_range(chunk, file.len()).map_err(ImportError::file)?;
    let mut position = range.start;
    let (mut values, mut dictionary, mut data) = (0, 0, 0);
    while position < range.end {
        let left = range.end - position;
        let (header, length) = read_header(file, position, left)?;
        let pages = left - length;
        let memory = check_page(&header, pages)
            .map_err(|reason| ImportError::file(format!("the page at byte {position} {reason}")))?;
        match header.page_type {
            DICTIONARY_PAGE => dictionary = dictionary.max(memory),
            _ => {
                data = data.max(memory);
                values += header.values.unsigned_abs();
            }
        }
        position += length + header.compressed.unsigned_abs();
    }
    if values != rows {
        let reason = format!("its pages have {values} values where the row group has {rows} rows");
        return Err(ImportError::file(reason));
    }
    Ok(dictionary + data)
}

/// The other codecs do not say how much comes out of them.
fn check_codec(codec: Compression) -> Result<(), String> {
    match codec {
        Compression::UNCOMPRESSED
        | Compression::SNAPPY
        | Compression::ZSTD(_)
        | Compression::LZ4_RAW => Ok(()),
        other => {
            let name = other.to_string();
            Err(format!("it is compressed with {name}, allowed: none, snappy, zstd, lz4-raw"))
        }
    }
}

/// Where the pages lie.
fn byte_range(chunk: &ColumnChunkMetaData, size: u64) -> Result<std::ops::Range<u64>, String> {
    let start = chunk.dictionary_page_offset().unwrap_or_else(|| chunk.data_page_offset());
    let length = chunk.compressed_size();
    let range = u64::try_from(start).ok().zip(u64::try_from(length).ok());
    match range.and_then(|(start, length)| Some(start..start.checked_add(length)?)) {
        Some(range) if range.end <= size => Ok(range),
        _ => Err(format!("its pages would lie at {start}, {length} bytes, in a file of {size}")),
    }
}

/// The header at `position`, and its length.
fn read_header<R: ChunkReader>(
    file: &R,
    position: u64,
    left: u64,
) -> Result<(PageHeader, u64), ImportError> {
    for enough in [USUAL_HEADER_BYTES, MAX_HEADER_BYTES] {
        let length = usize::try_from(left.min(enough)).unwrap_or(usize::MAX);
        let bytes = file.get_bytes(position, length)?;
        let mut thrift = Thrift::new(&bytes);
        if let Some(header) = page_header(&mut thrift) {
            return Ok((header, thrift.position() as u64));
        }
    }
    Err(ImportError::file(format!("no page begins at byte {position}, where one should")))
}

fn page_header(thrift: &mut Thrift<'_>) -> Option<PageHeader> {
    let mut header = PageHeader::default();
    // A header may hold several of them, and its type says which one counts.
    let (mut data, mut dictionary, mut data_v2) = Default::default();
    let mut last = 0;
    while let Some(field) = thrift.field(last)? {
        last = field.id;
        match field {
            Field { id: 1, .. } => header.page_type = thrift.integer(field)?,
            Field { id: 2, .. } => header.uncompressed = thrift.integer(field)?,
            Field { id: 3, .. } => header.compressed = thrift.integer(field)?,
            Field { id: 5, kind: kind::STRUCT } => data = values_and_encoding(thrift, 2)?,
            Field { id: 7, kind: kind::STRUCT } => dictionary = values_and_encoding(thrift, 2)?,
            Field { id: 8, kind: kind::STRUCT } => data_v2 = values_and_encoding(thrift, 4)?,
            other => thrift.skip(other.kind)?,
        }
    }
    (header.values, header.encoding) = match header.page_type {
        DICTIONARY_PAGE => dictionary,
        DATA_PAGE_V2 => data_v2,
        _ => data,
    };
    Some(header)
}

/// Of the header of a page of one type, in which field 1 is the number of values.
fn values_and_encoding(thrift: &mut Thrift<'_>, encoding_field: i16) -> Option<(i64, i64)> {
    let (mut values, mut encoding) = (0, 0);
    let mut last = 0;
    while let Some(field) = thrift.field(last)? {
        last = field.id;
        match field.id {
            1 => values = thrift.integer(field)?,
            id if id == encoding_field => encoding = thrift.integer(field)?,
            _ => thrift.skip(field.kind)?,
        }
    }
    Some((values, encoding))
}

/// The bytes that decoding a page takes.
fn check_page(header: &PageHeader, left: u64) -> Result<u64, String> {
    let PageHeader { page_type, uncompressed, compressed, values, encoding } = *header;
    // The format has 32 bits with a sign for each of them.
    let number = |what: &str, value: i64| match i32::try_from(value).map(u64::try_from) {
        Ok(Ok(value)) => Ok(value),
        _ => Err(format!("claims {value} {what}")),
    };
    let uncompressed = number("uncompressed bytes", uncompressed)?;
    let compressed = number("compressed bytes", compressed)?;
    let values = number("values", values)?;
    if compressed > left {
        return Err(format!("claims {compressed} bytes where {left} are left"));
    }
    let pages = uncompressed + compressed;
    match (page_type, encoding) {
        // Its values lie there once as bytes and once decoded, and none is shorter than a byte.
        (DICTIONARY_PAGE, PLAIN | PLAIN_DICTIONARY) if values <= uncompressed => {
            Ok(pages + uncompressed)
        }
        (DICTIONARY_PAGE, PLAIN | PLAIN_DICTIONARY) => {
            Err(format!("claims {values} values in {uncompressed} bytes"))
        }
        (
            DATA_PAGE | DATA_PAGE_V2,
            PLAIN | PLAIN_DICTIONARY | RLE_DICTIONARY | BYTE_STREAM_SPLIT | DELTA_BINARY_PACKED,
        ) => Ok(pages),
        // The lengths are decoded all at once.
        (DATA_PAGE | DATA_PAGE_V2, DELTA_LENGTH_BYTE_ARRAY) => Ok(pages + 4 * values),
        (DICTIONARY_PAGE | DATA_PAGE | DATA_PAGE_V2, other) => Err(format!(
            "has encoding {other}, allowed: PLAIN, RLE_DICTIONARY, BYTE_STREAM_SPLIT, \
             DELTA_BINARY_PACKED, DELTA_LENGTH_BYTE_ARRAY"
        )),
        (other, _) => Err(format!("is of type {other}, which is not known")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: PageHeader = PageHeader {
        page_type: DATA_PAGE,
        uncompressed: 100,
        compressed: 50,
        values: 9,
        encoding: 0,
    };

    #[test]
    fn a_header_is_read_with_its_values_and_encoding() {
        let bytes = [
            0x15, 0x00, 0x15, 0xc8, 0x01, 0x15, 0x64, // type, uncompressed, compressed
            0x2c, 0x15, 0x12, 0x15, 0x10, 0x15, 0x06, 0x15, 0x06,
            0x00, // 9 values, encoding 8
            0x00,
        ];
        let header = page_header(&mut Thrift::new(&bytes)).unwrap();
        assert_eq!(header, PageHeader { encoding: RLE_DICTIONARY, ..PAGE });
    }

    /// The decoder takes the one that belongs to the type of the page.
    #[test]
    fn of_several_headers_the_one_of_the_type_counts() {
        let bytes = [
            0x15, 0x00, 0x15, 0x64, 0x15, 0x64, // a data page
            0x2c, 0x15, 0x12, 0x00, // with 9 values
            0x3c, 0x15, 0x02, 0x00, // or, were it of the second version, with 1
            0x00,
        ];
        let header = page_header(&mut Thrift::new(&bytes)).unwrap();
        assert_eq!((header.page_type, header.values), (DATA_PAGE, 9));
    }

    #[test]
    fn codecs_that_do_not_say_how_much_comes_out_are_refused() {
        use parquet::basic::{BrotliLevel, GzipLevel};
        assert!(check_codec(Compression::SNAPPY).is_ok());
        let gzip = check_codec(Compression::GZIP(GzipLevel::default())).unwrap_err();
        assert!(gzip.contains("GZIP") && gzip.contains("zstd"), "{gzip}");
        assert!(check_codec(Compression::BROTLI(BrotliLevel::default())).is_err());
        assert!(check_codec(Compression::LZ4).is_err());
    }

    #[test]
    fn a_page_that_claims_what_is_not_there_is_refused() {
        assert_eq!(check_page(&PAGE, 50), Ok(150));
        assert!(check_page(&PAGE, 49).is_err());
        let refused = |header: PageHeader| check_page(&header, 1000).unwrap_err();
        refused(PageHeader { uncompressed: -1, ..PAGE });
        refused(PageHeader { values: -1, ..PAGE });
        refused(PageHeader { uncompressed: 1 << 32, ..PAGE });
        refused(PageHeader { encoding: 7, ..PAGE });
        refused(PageHeader { page_type: 1, ..PAGE });
        refused(PageHeader { page_type: DICTIONARY_PAGE, values: 1 << 30, ..PAGE });
    }
}
