//! The colours of a drawing, on white and on a dark page.

use std::fmt::Write;

/// Red, green and blue.
pub(crate) type Rgb = (u8, u8, u8);

pub(crate) const GROUND: Rgb = (0xFF, 0xFF, 0xFF);
pub(crate) const INK: Rgb = (0x22, 0x22, 0x22);
pub(crate) const AXIS: Rgb = (0x55, 0x55, 0x55);
pub(crate) const GRID: Rgb = (0xD6, 0xD6, 0xD6);
pub(crate) const FINE_GRID: Rgb = (0xEC, 0xEC, 0xEC);
pub(crate) const SHADE: Rgb = (0x80, 0x80, 0x80);

/// Okabe and Ito's colours for all kinds of colour vision (https://jfly.uni-koeln.de/color/), those
/// first that differ most from each other; without their yellow, which is hard to see on white. Three dark ones follow, which
/// are as far from those and from each other.
pub(crate) const PALETTE: [Rgb; 10] = [
    (0x00, 0x72, 0xB2), // blue
    (0xD5, 0x5E, 0x00), // vermillion
    (0x00, 0x9E, 0x73), // bluish green
    (0xCC, 0x79, 0xA7), // reddish purple
    (0xE6, 0x9F, 0x00), // orange
    (0x56, 0xB4, 0xE9), // sky blue
    (0x00, 0x00, 0x00), // black
    (0x1A, 0x1A, 0x99), // navy
    (0x87, 0x3C, 0x69), // wine
    (0x5C, 0x4A, 0x1E), // brown
];

/// The place of black in the palette, or of white on a dark page: the colour of what was measured.
pub const MEASURED: usize = 6;

/// The places of the other colours, for what is compared with a measurement.
pub const COMPARED: [usize; 9] = [0, 1, 2, 3, 4, 5, 7, 8, 9];

/// The place in the palette of the `place`-th of things that are compared. After the last colour the
/// first comes again, with another marker: four times, until the markers are used up.
#[must_use]
pub const fn compared(place: usize) -> usize {
    COMPARED[place % COMPARED.len()] + PALETTE.len() * (place / COMPARED.len())
}

/// The colours of the palette on a dark page: the same hues, bright enough to be seen there. The last two have others, because no
/// bright wine or brown is far enough from the rest.
const DARK_PALETTE: [Rgb; 10] = [
    (0x4D, 0xA3, 0xE8), // blue
    (0xF0, 0x7A, 0x35), // vermillion
    (0x2F, 0xC4, 0x97), // bluish green
    (0xE0, 0x9A, 0xC4), // reddish purple
    (0xFF, 0xBE, 0x1A), // orange
    (0xA5, 0xDA, 0xF8), // sky blue
    (0xF4, 0xF4, 0xF4), // in place of black
    (0x5A, 0x5A, 0xD2), // navy
    (0xC0, 0x39, 0x2B), // in place of wine
    (0x69, 0x87, 0x69), // in place of brown
];

/// The other colours on white, and what becomes of them on a dark page.
const DARK: [(Rgb, Rgb); 6] = [
    (GROUND, (0x1B, 0x1D, 0x20)),
    (INK, (0xE7, 0xE8, 0xEA)),
    (AXIS, (0xA0, 0xA4, 0xAB)),
    (GRID, (0x42, 0x47, 0x4D)),
    (FINE_GRID, (0x2B, 0x2E, 0x32)),
    (SHADE, (0x9A, 0xA0, 0xA8)),
];

/// The content of a drawing's `<style>` element, which is the same in all drawings: where the reader prefers a dark page,
/// each colour is replaced. A page whose policy refuses styles by default has to allow this text.
#[must_use]
pub fn style() -> String {
    let mut style = "@media screen and (prefers-color-scheme: dark) {".to_owned();
    for (light, dark) in DARK.into_iter().chain(PALETTE.into_iter().zip(DARK_PALETTE)) {
        let (light, dark) = (hex(light), hex(dark));
        for property in ["fill", "stroke"] {
            // Writing to a string cannot fail.
            let _ = write!(style, " svg [{property}=\"{light}\"] {{ {property}: {dark} }}");
        }
    }
    style.push_str(" }");
    style
}

/// As plotters writes colours.
pub(crate) fn hex((red, green, blue): Rgb) -> String {
    format!("#{red:02X}{green:02X}{blue:02X}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How red, green and blue light look to people without one kind of cone: Machado, Oliveira and Fernandes (2009),
    /// severity 1.
    const VISIONS: [[[f64; 3]; 3]; 4] = [
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ],
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ],
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ],
    ];

    fn linear((red, green, blue): Rgb) -> [f64; 3] {
        [red, green, blue].map(|byte| {
            let share = f64::from(byte) / 255.0;
            if share <= 0.04045 { share / 12.92 } else { ((share + 0.055) / 1.055).powf(2.4) }
        })
    }

    fn times(matrix: &[[f64; 3]; 3], vector: [f64; 3]) -> [f64; 3] {
        matrix.map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum())
    }

    /// CIELAB of linear sRGB, for daylight (D65).
    fn lab(rgb: [f64; 3]) -> [f64; 3] {
        let to_xyz = [
            [0.4124564, 0.3575761, 0.1804375],
            [0.2126729, 0.7151522, 0.0721750],
            [0.0193339, 0.1191920, 0.9503041],
        ];
        let [x, y, z] = times(&to_xyz, rgb.map(|share| share.clamp(0.0, 1.0)));
        let f = |t: f64| if t > 0.008856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 };
        let (x, y, z) = (f(x / 0.95047), f(y), f(z / 1.08883));
        [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
    }

    #[test]
    fn ten_colours_stay_apart_for_every_kind_of_colour_vision() {
        // A difference of 2.3 is just noticeable.
        for palette in [PALETTE, DARK_PALETTE] {
            for vision in &VISIONS {
                let seen = palette.map(|rgb| lab(times(vision, linear(rgb))));
                for (k, a) in seen.iter().enumerate() {
                    for (l, b) in seen.iter().enumerate().take(k) {
                        let apart = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
                        let apart = apart.sqrt();
                        assert!(apart > 12.0, "colours {l} and {k} are {apart} apart");
                    }
                }
            }
        }
    }

    #[test]
    fn every_colour_is_seen_on_its_ground() {
        let luminance = |rgb: Rgb| {
            let [red, green, blue] = linear(rgb);
            0.2126 * red + 0.7152 * green + 0.0722 * blue
        };
        let dark_ground = DARK[0].1;
        for (palette, ground) in [(PALETTE, GROUND), (DARK_PALETTE, dark_ground)] {
            for rgb in palette {
                let (a, b) = (luminance(rgb), luminance(ground));
                let contrast = (a.max(b) + 0.05) / (a.min(b) + 0.05);
                assert!(contrast > 2.2, "{rgb:?} has a contrast of {contrast} to {ground:?}");
            }
        }
    }
}
