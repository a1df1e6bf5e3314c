//! Recognizes files of other formats by their first bytes, so that an error says what they are.

/// Number of bytes that tell a format.
pub(super) const LENGTH: usize = 16;

/// The first bytes, what such a file is, and what to do with it.
const SIGNATURES: [(&[u8], &str, &str); 16] = [
    (b"\x1f\x8b", "compressed with gzip", "unpack it with gunzip"),
    (b"\x28\xb5\x2f\xfd", "compressed with Zstandard", "unpack it with unzstd"),
    (b"\xfd7zXZ\0", "compressed with xz", "unpack it with unxz"),
    (b"BZh", "compressed with bzip2", "unpack it with bunzip2"),
    (b"\x04\x22\x4d\x18", "compressed with LZ4", "unpack it with unlz4"),
    (
        b"PK\x03\x04",
        "a ZIP archive, such as an Excel workbook or NumPy arrays",
        "save the sheet as CSV, or say so: \"format\": \"npz\"",
    ),
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook", "save the sheet as CSV"),
    (b"PAR1", "a Parquet file", "say so: \"format\": \"parquet\""),
    (b"ARROW1", "an Arrow or Feather file", "write it as Parquet"),
    (b"\x89HDF\r\n", "an HDF5 file", "write its columns as Parquet or CSV"),
    (b"\x93NUMPY", "a single NumPy array", "write arrays with numpy.savez"),
    (b"#ROSBAG", "a ROS bag", "write its messages as Parquet or CSV"),
    (b"\x89MCAP0", "an MCAP file", "say so: \"format\": \"mcap\""),
    (
        b"SQLite format 3",
        "an SQLite database, such as a ROS 2 bag",
        "convert a bag with ros2 bag convert (output storage mcap), or write the table as Parquet or CSV",
    ),
    (b"\xff\xfe", "text in UTF-16", "save it as UTF-8"),
    (b"\xfe\xff", "text in UTF-16", "save it as UTF-8"),
];

/// Names the format of a file that begins like one of another format, and says how to convert it.
pub(super) fn describe(first: &[u8]) -> Option<String> {
    let (_, what, remedy) = SIGNATURES.iter().find(|(bytes, ..)| first.starts_with(bytes))?;
    Some(format!("it is {what}; {remedy}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_signature_fits_into_the_bytes_that_are_read() {
        assert!(SIGNATURES.iter().all(|(bytes, ..)| bytes.len() <= LENGTH));
        assert_eq!(describe(b"time,u1,u2"), None);
        assert_eq!(describe(b""), None);
    }
}
