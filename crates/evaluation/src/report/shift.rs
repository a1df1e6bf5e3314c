//! The shift of a cell: how its torques differ from those of the checkpoints' trainings.

use spec::{Excitation, Family, Range};
use wire::{Shift, TrainedOn};

use crate::CellResult;

/// Grids are written in decimals, so 0.1 + 0.05 must count as 0.15.
const TOLERANCE: f64 = 1e-9;

/// The frequencies and amplitudes in a training on `excitation`.
pub fn trained_on(excitation: &Excitation) -> impl Iterator<Item = TrainedOn> {
    Family::ALL.into_iter().filter_map(|family| {
        let frequency_hz = excitation.support(family)?;
        Some(TrainedOn { family, frequency_hz, amplitude: excitation.amplitude(family) })
    })
}

/// The excitations of several data that one model trained on: for each family, the interval around
/// their frequencies and amplitudes. An amplitude that some of them do not have is left out.
pub fn trained_on_together(each: impl IntoIterator<Item = TrainedOn>) -> Vec<TrainedOn> {
    let around = |a: Range, b: Range| Range::new(a.min.min(b.min), a.max.max(b.max));
    let mut all: Vec<TrainedOn> = Vec::new();
    for one in each {
        match all.iter_mut().find(|known| known.family == one.family) {
            Some(known) => {
                known.frequency_hz = around(known.frequency_hz, one.frequency_hz);
                known.amplitude =
                    known.amplitude.zip(one.amplitude).map(|(known, one)| around(known, one));
            }
            None => all.push(one),
        }
    }
    all
}

/// The shift of a cell from one training. `None` for cells without a frequency and for trainings on
/// recordings.
///
/// Frequency is checked before amplitude, since a multisine above the band has larger torques, too.
fn from_training(
    cell: &CellResult,
    seen: &[TrainedOn],
    excitation: Option<&Excitation>,
) -> Option<Shift> {
    let (family, frequency_hz) = (cell.family?, cell.frequency_hz?);
    if seen.is_empty() {
        // The excitation of recordings is not known.
        return None;
    }
    let Some(seen) = seen.iter().find(|seen| seen.family == family) else {
        return Some(Shift::Family);
    };
    let asked = excitation.and_then(|excitation| excitation.amplitude(family));
    Some(match seen.frequency_hz {
        band if frequency_hz < band.min - TOLERANCE => Shift::Below,
        band if frequency_hz > band.max + TOLERANCE => Shift::Above,
        _ if asked.zip(seen.amplitude).is_some_and(|(asked, seen)| is_beyond(asked, seen)) => {
            Shift::Amplitude
        }
        _ => Shift::Within,
    })
}

fn is_beyond(asked: Range, seen: Range) -> bool {
    asked.min < seen.min - TOLERANCE || asked.max > seen.max + TOLERANCE
}

/// The shift of a cell from the trainings of all checkpoints: the first one other than `Within`, if
/// there is any. `None` without checkpoints.
pub(super) fn shift(
    cell: &CellResult,
    trained_on: &[Vec<TrainedOn>],
    excitation: Option<&Excitation>,
) -> Option<Shift> {
    let of_each = || trained_on.iter().map(|seen| from_training(cell, seen, excitation));
    of_each().find(|shift| *shift != Some(Shift::Within)).or_else(|| of_each().next())?
}

/// The data that all trainings have in common: the intersection of their intervals, per family.
pub(super) fn common(trained_on: &[Vec<TrainedOn>]) -> Vec<TrainedOn> {
    let Some((first, others)) = trained_on.split_first() else { return Vec::new() };
    first
        .iter()
        .filter_map(|seen| {
            others.iter().try_fold(*seen, |common, other| {
                let other = other.iter().find(|other| other.family == common.family)?;
                let min = common.frequency_hz.min.max(other.frequency_hz.min);
                let max = common.frequency_hz.max.min(other.frequency_hz.max);
                (min <= max).then_some(TrainedOn { frequency_hz: Range { min, max }, ..common })
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests::cell;

    fn excitation(json: &serde_json::Value) -> Excitation {
        serde_json::from_value(json.clone()).unwrap()
    }

    #[test]
    fn a_fine_tuning_has_seen_what_the_training_before_it_saw() {
        let of = |family: &str, band: [f64; 2]| {
            let excitation_json = serde_json::json!({family: {"frequency_hz": {"uniform": band}}});
            trained_on(&excitation(&excitation_json)).collect::<Vec<_>>()
        };
        let parts =
            [of("chirp", [0.1, 0.2]), of("multisine", [0.3, 0.4]), of("chirp", [0.15, 0.5])];
        let seen = trained_on_together(parts.concat());
        let bands: Vec<_> = seen.iter().map(|seen| (seen.family, seen.frequency_hz)).collect();
        let expected =
            [(Family::Chirp, Range::new(0.1, 0.5)), (Family::Multisine, Range::new(0.3, 0.4))];
        assert_eq!(bands, expected);
    }

    #[test]
    fn frequencies_amplitudes_and_families_are_shifts_of_their_own() {
        let training = excitation(&serde_json::json!({
            "multisine": {"frequency_hz": {"uniform": [0.05, 0.15]}},
        }));
        let louder = excitation(&serde_json::json!({
            "multisine": {"frequency_hz": {"grid": [0.1]}, "amplitude_nm_per_hz": [-90, 90]},
        }));
        let seen: Vec<Vec<TrainedOn>> = vec![trained_on(&training).collect()];
        let found = |frequency_hz: f64, asked: &Excitation| {
            shift(&cell(0, frequency_hz, 1.0, 2.0), &seen, Some(asked)).unwrap()
        };
        assert_eq!(found(0.01, &training), Shift::Below);
        assert_eq!(found(0.1, &training), Shift::Within);
        assert_eq!(found(0.1 + 0.05, &training), Shift::Within);
        assert_eq!(found(0.2, &training), Shift::Above);
        assert_eq!(found(0.1, &louder), Shift::Amplitude);
        assert_eq!(found(0.2, &louder), Shift::Above);
        let chirp = CellResult { family: Some(Family::Chirp), ..cell(0, 0.1, 1.0, 2.0) };
        assert_eq!(shift(&chirp, &seen, Some(&training)), Some(Shift::Family));
        assert_eq!(shift(&chirp, &[], Some(&training)), None);
        assert_eq!(shift(&chirp, &[Vec::new()], Some(&training)), None);
    }
}
