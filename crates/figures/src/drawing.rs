//! Draws a layout as an SVG document.
//!
//! plotters draws each part on a canvas of its own, which is then wrapped in a group, because the
//! canvas has no dashes, no clipping and no named groups.

use plotters::prelude::{ChartBuilder, IntoDrawingArea, RGBColor, SVGBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontDesc, FontFamily, FontStyle, ShapeStyle, TextStyle};
use plotters_backend::DrawingBackend;

use crate::coordinate::{SUBPIXELS, subpixels};
use crate::layout::{
    BandLabel, FONT_SIZE, LEGEND_LINE, LEGEND_SPACE, Layout, MARGIN, PlacedBand, TITLE_FONT_SIZE,
    X_AXIS_HEIGHT,
};
use crate::marks::{CurveStyle, Drawn};
use crate::trace::Trace;
use crate::{Figure, FigureError, SERIES_ALLOWED, Size, Stroke, description, numbers, text, theme};

const INK: RGBColor = color(theme::INK);
const AXIS: RGBColor = color(theme::AXIS);
const GRID: RGBColor = color(theme::GRID);
const FINE_GRID: RGBColor = color(theme::FINE_GRID);
const SHADE: RGBColor = color(theme::SHADE);
const FONT: &str = "system-ui, sans-serif";
/// Space around the plot for markers and lines of points on its edge, in CSS pixels.
const OVERHANG: f64 = 6.0;

/// The figure as a document that fills the width of its container.
pub(crate) fn svg(figure: &Figure, size: Size) -> Result<String, FigureError> {
    let (traces, layout) = arrange(figure, size, 0.0)?;
    let style = format!("<style>{}</style>\n", theme::style());
    draw(figure, &traces, &layout, "width=\"100%\"", &style)
}

/// The figure as a part of a larger drawing, `top` pixels from its upper edge. Its plot begins at
/// least `left` pixels from the left edge.
pub(crate) fn panel(
    figure: &Figure,
    size: Size,
    top: u32,
    left: f64,
) -> Result<String, FigureError> {
    let Size { width, height } = size;
    let (traces, layout) = arrange(figure, size, left)?;
    let place = format!("y=\"{top}\" width=\"{width}\" height=\"{height}\"");
    draw(figure, &traces, &layout, &place, "")
}

/// The left edge of the figure's plot by default, in pixels.
pub(crate) fn left_of_plot(figure: &Figure, size: Size) -> Result<f64, FigureError> {
    let (_, layout) = arrange(figure, size, 0.0)?;
    Ok(layout.plot.left)
}

fn arrange(figure: &Figure, size: Size, left: f64) -> Result<(Vec<Trace>, Layout), FigureError> {
    size.check()?;
    for (what, count) in [("series", figure.series.len()), ("bands", figure.bands.len())] {
        if count > SERIES_ALLOWED {
            return Err(FigureError::TooMany { what, count });
        }
    }
    let traces: Vec<Trace> = figure
        .series
        .iter()
        .map(|series| Trace::new(&series.points, &figure.x, &figure.y))
        .collect();
    let layout = Layout::new(figure, &traces, size, left)?;
    Ok((traces, layout))
}

const fn color((red, green, blue): theme::Rgb) -> RGBColor {
    RGBColor(red, green, blue)
}

/// `place` is what the root element says of its position and size; `style` is its `<style>` element, if it has one.
fn draw(
    figure: &Figure,
    traces: &[Trace],
    layout: &Layout,
    place: &str,
    style: &str,
) -> Result<String, FigureError> {
    let curve_styles: Vec<CurveStyle> = figure
        .series
        .iter()
        .zip(traces)
        .enumerate()
        .map(|(index, (series, trace))| CurveStyle::new(index, series, trace))
        .collect();

    let empty = traces.iter().all(|trace| trace.drawable == 0);
    let mut body = format!("<g class=\"frame\">\n{}{}</g>\n", bands(layout)?, frame(layout)?);
    body.push_str(&data(figure, layout, &curve_styles, traces)?);
    body.push_str(&legend(layout, &curve_styles)?);
    body.push_str(&titles(layout, empty)?);
    let numbers = numbers::json(figure, layout, &curve_styles, traces);
    Ok(document(figure, traces, &numbers, layout.size, (place, style), &body))
}

/// The root element around the drawn groups.
fn document(
    figure: &Figure,
    traces: &[Trace],
    numbers: &str,
    size: Size,
    (place, style): (&str, &str),
    body: &str,
) -> String {
    let Size { width, height } = size;
    let ground = theme::hex(theme::GROUND);
    let title = text::xml(&figure.title);
    let description = text::xml(&description::describe(figure, traces));
    let numbers = text::xml(numbers);
    let shrink = 1.0 / f64::from(SUBPIXELS);
    format!(
        r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" {place} role="img">
<title>{title}</title>
<desc>{description}</desc>
<metadata>{numbers}</metadata>
{style}<rect width="{width}" height="{height}" rx="8" fill="{ground}"/>
<g transform="scale({shrink})" stroke-linejoin="round">
{body}</g>
</svg>
"##
    )
}

/// The output of `draw` on an empty canvas, without the canvas's own root element.
fn canvas<E>(
    layout: &Layout,
    name: &'static str,
    draw: impl FnOnce(SVGBackend) -> Result<(), E>,
) -> Result<String, FigureError>
where
    E: std::error::Error + Send + Sync + 'static,
{
    let size = [layout.size.width, layout.size.height].map(|n| u32::from(n) * u32::from(SUBPIXELS));
    let mut drawn = String::new();
    draw(SVGBackend::with_string(&mut drawn, (size[0], size[1])))
        .map_err(|source| FigureError::Drawing { layer: name, source: Box::new(source) })?;
    match inside(&drawn) {
        Some(inner) => Ok(inner.to_owned()),
        None => Err(FigureError::NoSvg { layer: name, found: shortened(&drawn) }),
    }
}

/// The content of a document's root element.
fn inside(document: &str) -> Option<&str> {
    let (root, rest) = document.split_once(">\n")?;
    rest.strip_suffix("</svg>\n").filter(|_| root.starts_with("<svg "))
}

/// The beginning of a text, long enough to recognize it.
fn shortened(text: &str) -> String {
    const SHOWN: usize = 60;
    let start = text.floor_char_boundary(SHOWN);
    let end = text.ceil_char_boundary(text.len().saturating_sub(SHOWN));
    if start >= end { text.to_owned() } else { format!("{} ... {}", &text[..start], &text[end..]) }
}

fn bands(layout: &Layout) -> Result<String, FigureError> {
    canvas(layout, "bands", |mut canvas| {
        for band in &layout.bands {
            draw_band(&mut canvas, layout, band)?;
        }
        canvas.present()
    })
}

fn draw_band(canvas: &mut SVGBackend, layout: &Layout, band: &PlacedBand) -> Drawn {
    // A narrow band must not look like a grid line.
    let alpha = if band.right - band.left < 8.0 { 0.55 } else { 0.22 };
    let upper = (subpixels(band.left), subpixels(layout.plot.top));
    let lower = (subpixels(band.right), subpixels(layout.plot.bottom));
    canvas.draw_rect(upper, lower, &ShapeStyle::from(&SHADE.mix(alpha)), true)?;
    if let Some(BandLabel { text, center, middle }) = &band.label {
        let style = font(FONT_SIZE, &AXIS).pos(Pos::new(HPos::Center, VPos::Center));
        canvas.draw_text(text, &style, (subpixels(*center), subpixels(*middle)))?;
    }
    Ok(())
}

/// Grid, axes, ticks and headings.
fn frame(layout: &Layout) -> Result<String, FigureError> {
    let plot = &layout.plot;
    let (width, height) = (f64::from(layout.size.width), f64::from(layout.size.height));
    canvas(layout, "axes", |canvas| {
        let area = canvas.into_drawing_area();
        let mut chart = ChartBuilder::on(&area)
            .margin_left(subpixels(MARGIN))
            .margin_right(subpixels(width) - subpixels(plot.right))
            .margin_top(subpixels(plot.top))
            .margin_bottom(subpixels(height) - subpixels(plot.bottom + X_AXIS_HEIGHT))
            .x_label_area_size(subpixels(X_AXIS_HEIGHT))
            .y_label_area_size(subpixels(plot.left) - subpixels(MARGIN))
            .build_cartesian_2d(layout.x.clone(), layout.y.clone())?;
        let hairline =
            |color: &RGBColor| ShapeStyle::from(color).stroke_width(u32::from(SUBPIXELS));
        chart
            .configure_mesh()
            .axis_style(hairline(&AXIS))
            .bold_line_style(hairline(&GRID))
            .light_line_style(hairline(&FINE_GRID))
            .label_style(font(FONT_SIZE, &INK))
            .axis_desc_style(font(FONT_SIZE, &INK))
            .set_all_tick_mark_size(subpixels(4.0))
            .x_desc(&layout.x_heading)
            .y_desc(&layout.y_heading)
            .draw()?;
        area.present()
    })
}

/// The series, clipped to the plot. A nested `<svg>` clips without needing an id.
fn data(
    figure: &Figure,
    layout: &Layout,
    curve_styles: &[CurveStyle],
    traces: &[Trace],
) -> Result<String, FigureError> {
    let plot = &layout.plot;
    let [x, y, width, height] = [
        plot.left - OVERHANG,
        plot.top - OVERHANG,
        plot.width() + 2.0 * OVERHANG,
        plot.height() + 2.0 * OVERHANG,
    ]
    .map(subpixels);
    let mut clipped = format!(
        "<svg class=\"data\" x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"{x} {y} {width} {height}\">\n"
    );
    // All ribbons lie below all lines.
    for (place, (curve_style, trace)) in curve_styles.iter().zip(traces).enumerate() {
        let ribbons = canvas(layout, "ribbons", |mut canvas| {
            curve_style.draw_ribbons(&mut canvas, layout, trace)?;
            canvas.present()
        })?;
        if !ribbons.is_empty() {
            clipped.push_str(&format!("<g data-series=\"{place}\">\n{ribbons}</g>\n"));
        }
    }
    let series = figure.series.iter().zip(curve_styles).zip(traces);
    for (place, ((series, curve_style), trace)) in series.enumerate() {
        let lines = canvas(layout, "lines", |mut canvas| {
            curve_style.draw_lines(&mut canvas, layout, trace)?;
            canvas.present()
        })?;
        let points = canvas(layout, "points", |mut canvas| {
            curve_style.draw_points(&mut canvas, layout, trace)?;
            canvas.present()
        })?;
        let name = text::xml(&series.name);
        let lines = stroked(curve_style.stroke, &lines);
        clipped.push_str(&format!(
            "<g data-series=\"{place}\">\n<title>{name}</title>\n{lines}{points}</g>\n"
        ));
    }
    clipped.push_str("</svg>\n");
    Ok(clipped)
}

fn legend(layout: &Layout, curve_styles: &[CurveStyle]) -> Result<String, FigureError> {
    let mut legend = String::new();
    for entry in &layout.legend {
        let curve_style = entry.series.and_then(|series| curve_styles.get(series));
        let mut drawn = String::new();
        if let Some(curve_style) = curve_style {
            let line = canvas(layout, "legend", |mut canvas| {
                curve_style.draw_legend_line(&mut canvas, entry)?;
                canvas.present()
            })?;
            drawn.push_str(&stroked(curve_style.stroke, &line));
        }
        drawn.push_str(&canvas(layout, "legend", |mut canvas| {
            if let Some(curve_style) = curve_style {
                curve_style.draw_legend_marker(&mut canvas, entry)?;
            }
            let style = font(FONT_SIZE, &INK).pos(Pos::new(HPos::Left, VPos::Center));
            let left = subpixels(entry.left + LEGEND_LINE + LEGEND_SPACE);
            canvas.draw_text(&entry.name, &style, (left, subpixels(entry.middle)))?;
            canvas.present()
        })?);
        match entry.series {
            Some(series) => legend
                .push_str(&format!("<g class=\"key\" data-series=\"{series}\">\n{drawn}</g>\n")),
            None => legend.push_str(&drawn),
        }
    }
    Ok(legend)
}

fn titles(layout: &Layout, empty: bool) -> Result<String, FigureError> {
    canvas(layout, "titles", |mut canvas| {
        let title = styled(TITLE_FONT_SIZE, &INK, FontStyle::Bold);
        let at = (subpixels(MARGIN), subpixels(MARGIN));
        canvas.draw_text(&layout.title, &title.pos(Pos::new(HPos::Left, VPos::Top)), at)?;
        if empty {
            let plot = &layout.plot;
            let middle = ((plot.left + plot.right) / 2.0, (plot.top + plot.bottom) / 2.0);
            let style = font(TITLE_FONT_SIZE, &AXIS).pos(Pos::new(HPos::Center, VPos::Center));
            canvas.draw_text("no data yet", &style, (subpixels(middle.0), subpixels(middle.1)))?;
        }
        canvas.present()
    })
}

/// Lines in a group, dashed if their series is.
fn stroked(stroke: Stroke, lines: &str) -> String {
    match stroke {
        Stroke::Solid | Stroke::Wide | Stroke::Faint => lines.to_owned(),
        Stroke::Dashed => {
            let (dash, gap) = (subpixels(7.0), subpixels(4.0));
            format!("<g stroke-dasharray=\"{dash} {gap}\">\n{lines}</g>\n")
        }
    }
}

fn font(size: f64, color: &'static RGBColor) -> TextStyle<'static> {
    styled(size, color, FontStyle::Normal)
}

fn styled(size: f64, color: &'static RGBColor, style: FontStyle) -> TextStyle<'static> {
    // plotters writes 1/1.24 of a font's size into the SVG.
    let size = size * 1.24 * f64::from(SUBPIXELS);
    TextStyle::from(FontDesc::new(FontFamily::Name(FONT), size, style)).color(color)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inside_of_a_document_is_what_was_drawn_and_other_text_is_none() {
        let document = "<svg width=\"9\">\n<rect/>\n</svg>\n";
        assert_eq!(inside(document), Some("<rect/>\n"));
        for other in ["", "<svg/>\n", "<svg width=\"9\">\n<rect/>\n", "<html>\n</svg>\n"] {
            assert_eq!(inside(other), None, "{other}");
        }
    }

    #[test]
    fn what_is_not_understood_is_shown_by_its_ends() {
        assert_eq!(shortened("no document"), "no document");
        let shown = shortened(&format!("begin{}é{}end", "-".repeat(500), "-".repeat(500)));
        assert!(shown.starts_with("begin---") && shown.ends_with("---end"), "{shown}");
        assert!(shown.len() < 130, "{shown}");
    }
}
