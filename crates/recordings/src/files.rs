//! The rows of several files.

use crate::ImportError;
use crate::rows::Rows;

/// The rows of files, one file after the other. A file is opened when those before it have been
/// read.
pub struct Files<S, I> {
    sources: S,
    /// The rows of the file that is being read, and its name if there are several files.
    current: Option<(Option<String>, I)>,
}

impl<S, I> Files<S, I> {
    /// The rows of `sources`, which open a file and give its name and its rows. The name becomes
    /// that of its recordings, and stands in errors.
    pub const fn new(sources: S) -> Self {
        Self { sources, current: None }
    }
}

impl<S, I, E> Iterator for Files<S, I>
where
    S: Iterator<Item = Result<(Option<String>, I), E>>,
    I: Iterator<Item = Result<Rows, ImportError>>,
    E: From<ImportError>,
{
    type Item = Result<Rows, E>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let Some((name, rows)) = &mut self.current else {
                match self.sources.next()? {
                    Ok(opened) => self.current = Some(opened),
                    Err(error) => return Some(Err(error)),
                }
                continue;
            };
            if let Some(read) = rows.next() {
                let read = match name {
                    None => read,
                    Some(name) => read
                        .map(|rows| rows.of_file(name))
                        .map_err(|error| ImportError::InFile(name.clone(), Box::new(error))),
                };
                return Some(read.map_err(E::from));
            }
            self.current = None;
        }
    }
}
