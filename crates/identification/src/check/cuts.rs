//! Torques that are cut off, and the sentences about them.

use super::comparison::Comparison;
use super::purpose::Purpose;
use super::told::{Doubt, Kind};
use crate::motion::Motion;
use crate::wording::digits;

/// A smaller share of the samples is no reason for doubt.
const LEAST_SHARE: f64 = 0.03;

/// The highest and the lowest level of a channel of torques, and the samples there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cuts {
    highest: Cut,
    lowest: Cut,
}

/// One level of a channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Cut {
    level_nm: f64,
    /// The share of all samples.
    share: f64,
}

impl Cuts {
    /// Those of all channels.
    pub fn all(motions: &[Motion], joints: usize) -> Vec<Self> {
        (0..joints).map(|joint| Self::of(motions, joint)).collect()
    }

    fn of(motions: &[Motion], joint: usize) -> Self {
        let samples: usize = motions.iter().map(Motion::samples).sum();
        let share_of = |is_cut: fn(&Motion, usize, f64) -> bool| {
            let count = |motion: &Motion| {
                let torques = motion.recorded_u.iter().map(|row| row[joint]);
                torques.filter(|torque| is_cut(motion, joint, *torque)).count()
            };
            motions.iter().map(count).sum::<usize>() as f64 / samples.max(1) as f64
        };
        let levels = || motions.iter().map(|motion| motion.saturation[joint]);
        let highest = Cut {
            level_nm: levels().filter_map(|it| it.highest_nm).fold(f64::NEG_INFINITY, f64::max),
            share: share_of(|motion, joint, torque| motion.saturation[joint].is_highest(torque)),
        };
        let lowest = Cut {
            level_nm: levels().filter_map(|it| it.lowest_nm).fold(f64::INFINITY, f64::min),
            share: share_of(|motion, joint, torque| motion.saturation[joint].is_lowest(torque)),
        };
        Self { highest, lowest }
    }

    /// The share of the samples that are cut off.
    pub fn share(&self) -> f64 {
        self.highest.share + self.lowest.share
    }

    /// `its highest value, 0.6 N·m, in 34 % of the samples`.
    fn list(&self) -> String {
        let levels = [(self.highest, "highest"), (self.lowest, "lowest")];
        let stands = levels.into_iter().filter(|(cut, _)| cut.share > 0.0);
        let parts: Vec<String> = stands
            .map(|(Cut { level_nm, share }, name)| {
                let percent = 100.0 * share;
                format!(
                    "its {name} value, {} N·m, in {percent:.0} % of the samples",
                    digits(level_nm)
                )
            })
            .collect();
        parts.join(" and at ")
    }
}

/// Torques that stand at their highest or lowest value.
pub fn of_cuts(found: &Comparison, purpose: Purpose, doubts: &mut Vec<Doubt>) {
    for (column, cuts) in found.cuts.iter().enumerate() {
        let size = cuts.share();
        if size < LEAST_SHARE {
            continue;
        }
        let (joint, list) = (column + 1, cuts.list());
        let more = match purpose {
            Purpose::Import => "",
            _ => " The fit leaves these samples out",
        };
        let text =
            format!("u of joint {joint} stands at {list}: is the torque cut off there?{more}");
        doubts.push(Doubt { kind: Kind::CutOff, joints: vec![column], size, text });
    }
}
