//! The columns of the table of robots that describe what moves them: the coefficients of torques, or
//! the reference and the gains of a controller.

use super::columns::{Column, ColumnType, number};
use super::excitation::{PULSES, STEP_LEVELS};

/// The reference and the gains of a controller. Both are JSON objects, because families and laws
/// differ in their numbers.
pub(super) fn tracking() -> [Column; 2] {
    [
        Column::new(
            "reference",
            ColumnType::Text,
            "JSON: the drawn reference, in rad and s from the start of the motion",
        ),
        Column::new(
            "controller",
            ColumnType::Text,
            "JSON: the gains of the robot's controller, one of each per joint, and its delay",
        ),
    ]
}

pub(super) fn chirps(joints: usize) -> impl Iterator<Item = Column> {
    const COEFFICIENTS: [(&str, &str); 6] = [
        ("chirp_offset_nm", "N·m"),
        ("chirp_amplitude_nm", "N·m"),
        ("chirp_f1_hz", "Hz"),
        ("chirp_f2_hz", "Hz"),
        ("chirp_depth", "1"),
        ("chirp_phase_rad", "rad"),
    ];
    COEFFICIENTS.into_iter().flat_map(move |(name, unit)| {
        (1..=joints).map(move |joint| {
            let about = format!(
                "of joint {joint}: offset + amplitude · cos(2π f1 (1 + depth · cos(2π f2 t)) t + \
                 phase); null unless a chirp"
            );
            number(format!("{name}_{joint}"), unit, about).nullable()
        })
    })
}

pub(super) fn multisines(joints: usize) -> impl Iterator<Item = Column> {
    (0..4).flat_map(move |part| {
        (1..=joints).flat_map(move |joint| {
            let wave = if part % 2 == 0 { "sin" } else { "cos" };
            let about = format!(
                "of joint {joint}: its part {part} is amplitude · {wave}(2π f t); null unless a \
                 multisine"
            );
            [("amplitude", "nm", "N·m"), ("f", "hz", "Hz")].map(|(what, suffix, unit)| {
                let name = format!("multisine_{what}{part}_{suffix}_{joint}");
                number(name, unit, about.clone()).nullable()
            })
        })
    })
}

pub(super) fn pulses(joints: usize) -> impl Iterator<Item = Column> {
    (0..PULSES).flat_map(move |part| {
        (1..=joints).flat_map(move |joint| {
            let about = format!(
                "of joint {joint}: pulse {part} rests, rises to its level, holds it and falls as it rose; after \
                 the last it begins again; null unless pulses"
            );
            [("level", "nm", "N·m"), ("rest", "s", "s"), ("rise", "s", "s"), ("hold", "s", "s")].map(
                |(what, suffix, unit)| {
                    let name = format!("pulses_{what}{part}_{suffix}_{joint}");
                    number(name, unit, about.clone()).nullable()
                },
            )
        })
    })
}

pub(super) fn steps(joints: usize) -> impl Iterator<Item = Column> {
    (0..STEP_LEVELS).flat_map(move |part| {
        (1..=joints).flat_map(move |joint| {
            let about = format!(
                "of joint {joint}: level {part} is held so long; after the last it begins again; null unless \
                 steps"
            );
            [("level", "nm", "N·m"), ("hold", "s", "s")].map(|(what, suffix, unit)| {
                let name = format!("steps_{what}{part}_{suffix}_{joint}");
                number(name, unit, about.clone()).nullable()
            })
        })
    })
}
