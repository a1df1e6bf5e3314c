//! Pages on their way to the decoder, once decompressed: what only their content shows.

use std::sync::Arc;

use parquet::basic::{Encoding, Type};
use parquet::column::page::{Page, PageIterator, PageMetadata, PageReader};
use parquet::errors::{ParquetError, Result};
use parquet::file::metadata::ColumnChunkMetaData;
use parquet::file::reader::ChunkReader;
use parquet::file::serialized_reader::SerializedPageReader;

use super::rows::MAX_NAME_BYTES;

/// The pages of a column in a row group.
pub(super) struct CheckedPages<R: ChunkReader> {
    pages: SerializedPageReader<R>,
    physical_type: Type,
    /// Whether definition levels precede the values of a page.
    nullable: bool,
}

impl<R: ChunkReader> CheckedPages<R> {
    pub fn new(file: Arc<R>, chunk: &ColumnChunkMetaData, rows: usize) -> Result<Self> {
        Ok(Self {
            pages: SerializedPageReader::new(file, chunk, rows, None)?,
            physical_type: chunk.column_type(),
            nullable: chunk.column_descr().max_def_level() > 0,
        })
    }

    fn check(&self, page: &Page) -> Result<()> {
        match page {
            Page::DictionaryPage { buf, .. } if self.physical_type == Type::BYTE_ARRAY => {
                check_names(buf)
            }
            Page::DictionaryPage { .. } => Ok(()),
            Page::DataPage { buf, num_values, encoding, def_level_encoding, .. } => {
                if self.nullable && *def_level_encoding != Encoding::RLE {
                    return Err(refused("its levels are not RLE"));
                }
                let levels = if self.nullable { level_bytes(buf)? } else { 0 };
                check_values(buf, levels, *num_values, *encoding)
            }
            Page::DataPageV2 {
                buf,
                num_values,
                encoding,
                def_levels_byte_len,
                rep_levels_byte_len,
                ..
            } => {
                let levels = u64::from(*def_levels_byte_len) + u64::from(*rep_levels_byte_len);
                let levels = usize::try_from(levels).unwrap_or(usize::MAX);
                check_values(buf, levels, *num_values, *encoding)
            }
        }
    }
}

fn refused(reason: &str) -> ParquetError {
    ParquetError::General(format!("a page is damaged: {reason}"))
}

/// A dictionary repeats its values in every batch, so that one long name would fill the memory.
fn check_names(mut dictionary: &[u8]) -> Result<()> {
    while let Some((length, rest)) = dictionary.split_first_chunk() {
        let length = usize::try_from(u32::from_le_bytes(*length)).unwrap_or(usize::MAX);
        if length > MAX_NAME_BYTES {
            let reason = format!("a name of {length} bytes, at most {MAX_NAME_BYTES} are allowed");
            return Err(ParquetError::General(reason));
        }
        dictionary = rest.get(length..).ok_or_else(|| refused("a name is cut off"))?;
    }
    Ok(())
}

/// Definition levels of a first-version page begin with their length.
fn level_bytes(page: &[u8]) -> Result<usize> {
    let length = page.first_chunk().map(|length| u32::from_le_bytes(*length));
    let length = length.ok_or_else(|| refused("its levels are cut off"))?;
    Ok(4 + usize::try_from(length).unwrap_or(usize::MAX - 4))
}

/// Delta-encoded lengths say for themselves how many they are, and the decoder believes them.
fn check_values(page: &[u8], levels: usize, values: u32, encoding: Encoding) -> Result<()> {
    if encoding != Encoding::DELTA_LENGTH_BYTE_ARRAY {
        return Ok(());
    }
    let encoded = page.get(levels..).ok_or_else(|| refused("its levels are cut off"))?;
    let count = third_number(encoded).ok_or_else(|| refused("no delta header"))?;
    if count > u64::from(values) {
        return Err(refused(&format!("{count} lengths of {values} values")));
    }
    Ok(())
}

/// A delta header is block size, miniblocks per block and number of values, as varints.
fn third_number(bytes: &[u8]) -> Option<u64> {
    let mut bytes = bytes.iter();
    let mut number = || {
        let mut value: u64 = 0;
        for shift in (0..64).step_by(7) {
            let byte = *bytes.next()?;
            value |= u64::from(byte & 0x7f).checked_shl(shift)?;
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    };
    number()?;
    number()?;
    number()
}

impl<R: ChunkReader> Iterator for CheckedPages<R> {
    type Item = Result<Page>;

    fn next(&mut self) -> Option<Self::Item> {
        self.get_next_page().transpose()
    }
}

impl<R: ChunkReader> PageReader for CheckedPages<R> {
    fn get_next_page(&mut self) -> Result<Option<Page>> {
        let page = self.pages.get_next_page()?;
        if let Some(page) = &page {
            self.check(page)?;
        }
        Ok(page)
    }

    fn peek_next_page(&mut self) -> Result<Option<PageMetadata>> {
        self.pages.peek_next_page()
    }

    fn skip_next_page(&mut self) -> Result<()> {
        self.pages.skip_next_page()
    }
}

/// The pages of one column chunk, which is all that is read at a time.
pub(super) struct OneChunk<R: ChunkReader>(pub Option<CheckedPages<R>>);

impl<R: ChunkReader + 'static> Iterator for OneChunk<R> {
    type Item = Result<Box<dyn PageReader>>;

    fn next(&mut self) -> Option<Self::Item> {
        self.0.take().map(|pages| Ok(Box::new(pages) as Box<dyn PageReader>))
    }
}

impl<R: ChunkReader + 'static> PageIterator for OneChunk<R> {}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(lengths: &[u32]) -> Vec<u8> {
        let name = |length: &u32| {
            let mut bytes = length.to_le_bytes().to_vec();
            bytes.resize(4 + *length as usize, b'x');
            bytes
        };
        lengths.iter().flat_map(name).collect()
    }

    #[test]
    fn a_dictionary_of_long_or_cut_names_is_refused() {
        assert!(check_names(&names(&[3, 0, 200])).is_ok());
        assert!(check_names(&names(&[3, 201])).is_err());
        assert!(check_names(&names(&[3, 9])[..12]).is_err());
    }

    #[test]
    fn more_lengths_than_values_are_refused() {
        let encoded = [0x80, 0x01, 0x04, 0xff, 0xff, 0x7f, 0x00];
        let check = |values| check_values(&encoded, 0, values, Encoding::DELTA_LENGTH_BYTE_ARRAY);
        assert!(check(9).is_err());
        assert!(check(u32::MAX).is_ok());
        assert!(check_values(&encoded, 9, 9, Encoding::DELTA_LENGTH_BYTE_ARRAY).is_err());
        assert!(check_values(&encoded, 0, 9, Encoding::PLAIN).is_ok());
    }
}
