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
/// first that differ most from each other; without their yellow, which is hard to see on white.
pub(crate) const PALETTE: [Rgb; 7] = [
    (0x00, 0x72, 0xB2), // blue
    (0xD5, 0x5E, 0x00), // vermillion
    (0x00, 0x9E, 0x73), // bluish green
    (0xCC, 0x79, 0xA7), // reddish purple
    (0xE6, 0x9F, 0x00), // orange
    (0x56, 0xB4, 0xE9), // sky blue
    (0x00, 0x00, 0x00), // black
];

/// The colours of the palette on a dark page: the same hues, bright enough to be seen there.
const DARK_PALETTE: [Rgb; 7] = [
    (0x4D, 0xA3, 0xE8), // blue
    (0xF0, 0x7A, 0x35), // vermillion
    (0x2F, 0xC4, 0x97), // bluish green
    (0xE0, 0x9A, 0xC4), // reddish purple
    (0xF2, 0xB6, 0x36), // orange
    (0xA5, 0xDA, 0xF8), // sky blue
    (0xF4, 0xF4, 0xF4), // in place of black
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
