//! The doubts about recordings and their parts that are told: each once, where it is worst.

use std::cmp::Ordering;

/// The kinds of doubts, in the order in which they are told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    PositionForTorque,
    Exchange,
    ExchangeOfPositions,
    ExchangeOfTorques,
    Sign,
    Rate,
    Scale,
    Weight,
    ShareOfWeight,
    Delay,
    Constant,
    CutOff,
    Unexplained,
    Position,
    Speed,
    Torque,
}

/// A probable mistake.
#[derive(Clone, Debug, PartialEq)]
pub struct Doubt {
    pub kind: Kind,
    /// The joints, or columns, that it is about, from 0.
    pub joints: Vec<usize>,
    /// A larger one is worse. Only those of one kind are comparable.
    pub size: f64,
    /// A sentence.
    pub text: String,
}

impl Doubt {
    fn is_about(&self, kind: Kind, joint: usize) -> bool {
        self.kind == kind && self.joints.contains(&joint)
    }

    /// Whether one of the joints is the same.
    fn is_like(&self, other: &Self) -> bool {
        self.joints.iter().any(|joint| other.is_about(self.kind, *joint))
    }
}

/// A part of the recordings, and the doubts about it.
pub struct Doubted {
    pub part: String,
    pub doubts: Vec<Doubt>,
}

impl Doubted {
    fn has_like(&self, doubt: &Doubt) -> bool {
        self.doubts.iter().any(|other| other.is_like(doubt))
    }
}

/// The sentences about recordings. A doubt about everything is told without a place; one about some
/// of the parts is told of the worst, with its name.
pub fn told(whole: Vec<Doubt>, parts: &[Doubted]) -> Vec<String> {
    let parts_with = |kind: Kind, joint: usize| {
        let has_it = |part: &&Doubted| part.doubts.iter().any(|doubt| doubt.is_about(kind, joint));
        parts.iter().filter(has_it).count()
    };
    let is_of_some_parts = |doubt: &Doubt| {
        let mut counts = doubt.joints.iter().map(|joint| parts_with(doubt.kind, *joint));
        counts.all(|count| 0 < count && count < parts.len())
    };
    let mut told: Vec<Doubt> = whole.into_iter().filter(|doubt| !is_of_some_parts(doubt)).collect();
    let mut of_parts: Vec<(&Doubted, &Doubt)> =
        parts.iter().flat_map(|part| part.doubts.iter().map(move |doubt| (part, doubt))).collect();
    of_parts.sort_by(|(_, a), (_, b)| worst_first(a, b));
    for (part, doubt) in of_parts {
        let is_told = |joint: &usize| told.iter().any(|told| told.is_about(doubt.kind, *joint));
        if doubt.joints.iter().all(is_told) {
            continue;
        }
        let more = parts.iter().filter(|other| other.has_like(doubt)).count() - 1;
        let place = match more {
            0 => part.part.clone(),
            1 => format!("{} and 1 more part", part.part),
            _ => format!("{} and {more} more parts", part.part),
        };
        told.push(Doubt { text: format!("{place}: {}", doubt.text), ..doubt.clone() });
    }
    told.sort_by_key(|doubt| doubt.kind);
    told.into_iter().map(|doubt| doubt.text).collect()
}

/// Those about many joints come before those about few, so that each joint is told once.
fn worst_first(a: &Doubt, b: &Doubt) -> Ordering {
    let of_joints = b.joints.len().cmp(&a.joints.len());
    of_joints.then(b.size.total_cmp(&a.size))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn doubt(kind: Kind, joints: &[usize], size: f64, text: &str) -> Doubt {
        Doubt { kind, joints: joints.to_vec(), size, text: text.to_owned() }
    }

    fn part(name: &str, doubts: &[Doubt]) -> Doubted {
        Doubted { part: name.to_owned(), doubts: doubts.to_vec() }
    }

    #[test]
    fn a_doubt_about_everything_has_no_place() {
        let sign = doubt(Kind::Sign, &[1], 1.0, "sign");
        assert_eq!(told(vec![sign.clone()], &[]), ["sign"]);
        let parts = ["a", "b"].map(|name| part(name, std::slice::from_ref(&sign)));
        assert_eq!(told(vec![sign.clone()], &parts), ["sign"]);
        let silent = ["a", "b"].map(|name| part(name, &[]));
        assert_eq!(told(vec![sign], &silent), ["sign"]);
    }

    #[test]
    fn a_doubt_about_some_parts_is_told_of_the_worst() {
        let whole = doubt(Kind::Unexplained, &[2], 0.4, "60 %");
        let [less, more] = [0.6, 0.8].map(|size| {
            doubt(Kind::Unexplained, &[2], size, if size < 0.7 { "40 %" } else { "20 %" })
        });
        let parts = [part("a", &[less]), part("b", &[]), part("c", &[more])];
        assert_eq!(told(vec![whole], &parts), ["c and 1 more part: 20 %"]);
    }

    #[test]
    fn doubts_of_other_kinds_and_joints_are_told_beside_each_other() {
        let parts = [
            part(
                "a",
                &[doubt(Kind::Delay, &[0], 5.0, "late 0"), doubt(Kind::Sign, &[0], 1.0, "sign")],
            ),
            part("b", &[doubt(Kind::Delay, &[0, 1], 4.0, "late 0 and 1")]),
            part("c", &[]),
        ];
        assert_eq!(told(Vec::new(), &parts), ["a: sign", "b and 1 more part: late 0 and 1"]);
    }
}
