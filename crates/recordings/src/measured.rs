//! A file's recordings as they were measured, at the times of its rows.

use crate::samples::Sample;

/// A recording before it is resampled and cut.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measured {
    /// Its name in the file; empty if the file names none. A piece of a recording ends in `from 120 s
    /// on`.
    pub name: String,
    /// Its rows. Their times rise.
    pub rows: Vec<MeasuredRow>,
}

/// A row of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredRow {
    /// Seconds from an arbitrary origin.
    pub time_s: f64,
    /// The position of each joint, rad.
    pub q: Vec<f64>,
    /// The torque of each joint, N·m.
    pub u: Vec<f64>,
}

/// Keeps rows as they were measured. With too many rows it leaves out pieces evenly, because a mistake
/// may begin at any time, and in any recording.
pub(crate) struct Keeper {
    joints: usize,
    most_rows: usize,
    /// The longest piece, s.
    most_s: f64,
    /// Every so many pieces one is kept.
    stride: usize,
    name: String,
    /// The first time of the recording, once it has a row.
    first_s: Option<f64>,
    /// The piece that the next row belongs to.
    now: Place,
    pieces: Vec<Piece>,
}

/// The place of a piece.
#[derive(Clone, Copy, Default)]
struct Place {
    /// Pieces that began before it, kept or not.
    number: usize,
    /// Seconds since the beginning of its recording.
    begins_s: f64,
    rows: usize,
}

/// Consecutive rows of a recording.
struct Piece {
    number: usize,
    name: String,
    begins_s: f64,
    /// Whether its recording goes on after it.
    is_cut: bool,
    rows: Vec<MeasuredRow>,
}

impl Keeper {
    /// The most rows that are kept: 24 minutes at 250 Hz, and 3 minutes at 2 kHz.
    const MOST_ROWS: usize = 360_000;
    /// The pieces of a fast recording are shorter, so that at least so many fit.
    const LEAST_PIECES: usize = 8;
    /// The longest piece.
    const MOST_S: f64 = 60.0;

    /// Keeps [`Self::MOST_ROWS`].
    pub fn new(joints: usize) -> Self {
        Self::of_most(joints, Self::MOST_ROWS, Self::MOST_S)
    }

    /// Keeps everything.
    pub fn of_all(joints: usize) -> Self {
        Self::of_most(joints, usize::MAX, f64::INFINITY)
    }

    fn of_most(joints: usize, most_rows: usize, most_s: f64) -> Self {
        Self {
            joints,
            most_rows,
            most_s,
            stride: 1,
            name: String::new(),
            first_s: None,
            now: Place::default(),
            pieces: Vec::new(),
        }
    }

    /// A recording begins.
    pub fn begin(&mut self, name: Option<&str>) {
        self.name = name.unwrap_or_default().to_owned();
        self.first_s = None;
    }

    /// The next sample of the recording.
    pub fn keep(&mut self, sample: &Sample) {
        match self.first_s {
            None => {
                self.first_s = Some(sample.time_s);
                self.begin_piece(0.0);
            }
            Some(first_s) => {
                let time_s = sample.time_s - first_s;
                let is_long = time_s - self.now.begins_s >= self.most_s;
                if is_long || self.now.rows >= self.most_rows / Self::LEAST_PIECES {
                    if let Some(piece) = self.kept() {
                        piece.is_cut = true;
                    }
                    self.begin_piece(time_s);
                }
            }
        }
        self.now.rows += 1;
        let joints = self.joints;
        let Some(piece) = self.kept() else { return };
        let (u, rest) = sample.values.split_at(joints);
        let row = MeasuredRow { time_s: sample.time_s, q: rest[..joints].to_vec(), u: u.to_vec() };
        piece.rows.push(row);
    }

    fn begin_piece(&mut self, begins_s: f64) {
        let number = self.now.number + 1;
        self.now = Place { number, begins_s, rows: 0 };
        let rows: usize = self.pieces.iter().map(|piece| piece.rows.len()).sum();
        if rows + self.most_rows / Self::LEAST_PIECES > self.most_rows {
            self.stride *= 2;
            self.pieces.retain(|piece| piece.number % self.stride == 1);
        }
        if self.stride == 1 || number % self.stride == 1 {
            let (name, rows) = (self.name.clone(), Vec::new());
            self.pieces.push(Piece { number, name, begins_s, is_cut: false, rows });
        }
    }

    /// The piece that rows belong to, if it is kept.
    fn kept(&mut self) -> Option<&mut Piece> {
        self.pieces.last_mut().filter(|piece| piece.number == self.now.number)
    }

    /// All recordings with two rows at least. Pieces that follow each other are one.
    pub fn recordings(self) -> Vec<Measured> {
        let mut joined: Vec<Piece> = Vec::new();
        for piece in self.pieces {
            match joined.last_mut().filter(|last| last.is_cut && last.number + 1 == piece.number) {
                Some(last) => {
                    last.rows.extend(piece.rows);
                    (last.number, last.is_cut) = (piece.number, piece.is_cut);
                }
                None => joined.push(piece),
            }
        }
        joined.retain(|piece| piece.rows.len() > 1);
        joined.into_iter().map(Piece::measured).collect()
    }
}

impl Piece {
    fn measured(self) -> Measured {
        let Self { name, begins_s, is_cut, rows, .. } = self;
        if begins_s == 0.0 && !is_cut {
            return Measured { name, rows };
        }
        let name = format!("{name} from {begins_s:.0} s on").trim_start().to_owned();
        Measured { name, rows }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Place;
    use crate::rows::MAX_CHANNELS;

    fn sample(time_s: f64) -> Sample {
        let mut values = [0.0; MAX_CHANNELS];
        values[..4].copy_from_slice(&[1.0, 2.0, time_s, 4.0]);
        Sample { time_s, row: 0, place: Place::Row(1), values }
    }

    /// Names and numbers of rows of what is kept of recordings of so many seconds at 1 Hz.
    fn kept(mut keeper: Keeper, recordings: &[(&str, u32)]) -> Vec<(String, usize)> {
        for (name, seconds) in recordings {
            keeper.begin(Some(*name));
            for second in 0..*seconds {
                keeper.keep(&sample(1000.0 + f64::from(second)));
            }
        }
        let kept = keeper.recordings().into_iter();
        kept.map(|recording| (recording.name, recording.rows.len())).collect()
    }

    #[test]
    fn recordings_of_few_rows_are_kept_whole() {
        let recordings = [("a", 100), ("b", 200), ("", 30)];
        let whole = recordings.map(|(name, seconds)| (name.to_owned(), seconds as usize));
        assert_eq!(kept(Keeper::new(2), &recordings), whole);
        assert_eq!(kept(Keeper::of_all(2), &recordings), whole);
        let mut keeper = Keeper::new(2);
        keeper.begin(None);
        (0..=80).for_each(|second| keeper.keep(&sample(f64::from(second))));
        let expected = MeasuredRow { time_s: 80.0, q: vec![80.0, 4.0], u: vec![1.0, 2.0] };
        assert_eq!(keeper.recordings()[0].rows[80], expected);
    }

    #[test]
    fn too_many_rows_are_thinned_over_all_recordings() {
        let found = kept(Keeper::of_most(2, 800, 60.0), &[("a", 2000), ("b", 90), ("", 600)]);
        let rows: usize = found.iter().map(|(_, rows)| rows).sum();
        assert!((300..=800).contains(&rows), "{found:?}");
        let begins: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(
            begins,
            [
                "a from 0 s on",
                "a from 480 s on",
                "a from 960 s on",
                "a from 1440 s on",
                "a from 1920 s on",
                "from 240 s on",
            ]
        );
        let many: Vec<(&str, u32)> = vec![("short", 5); 1000];
        let found = kept(Keeper::of_most(2, 800, 60.0), &many);
        assert!(found.len() > 50 && found.iter().all(|kept| *kept == ("short".to_owned(), 5)));
    }

    #[test]
    fn a_recording_of_one_row_shows_no_motion() {
        let mut keeper = Keeper::new(2);
        keeper.begin(None);
        keeper.keep(&sample(0.0));
        assert_eq!(keeper.recordings(), []);
    }
}
