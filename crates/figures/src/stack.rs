//! Several figures in one drawing.

use crate::{Figure, FigureError, Size, drawing, text, theme};

/// Draws figures one below the other in one self-contained `<svg>` element, each in `size`.
///
/// Use it for series over the same x whose y have different units. The plots begin at the same x.
///
/// # Errors
///
/// Like [`Figure::to_svg`], for the first figure that cannot be drawn.
pub fn stacked(title: &str, figures: &[Figure], size: Size) -> Result<String, FigureError> {
    let mut left: f64 = 0.0;
    for figure in figures {
        left = left.max(drawing::left_of_plot(figure, size)?);
    }
    let mut panels = String::new();
    let mut top = 0;
    for figure in figures {
        panels.push_str(&drawing::panel(figure, size, top, left)?);
        top += u32::from(size.height);
    }
    let title = text::xml(title);
    let (width, height) = (size.width, top.max(1));
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         width=\"100%\" role=\"group\">\n<title>{title}</title>\n<style>{}</style>\n{panels}</svg>\n",
        theme::style(),
    ))
}
