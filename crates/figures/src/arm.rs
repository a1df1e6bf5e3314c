//! Draws an arm from two sides.

use std::fmt::Write;

use crate::layout::{FONT_SIZE, MARGIN, TITLE_FONT_SIZE};
use crate::ticks::{self, Tick};
use crate::{FigureError, Scale, Size, text, theme};

/// An arm in one posture. All coordinates are those of the world, whose z points up, in m.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmFigure {
    /// Shown above the drawing.
    pub title: String,
    /// Where the arm stands.
    pub base_m: [f64; 3],
    /// Joints from the base to the hand.
    pub joints: Vec<ArmJoint>,
    /// Origin of the hand's frame.
    pub hand_m: [f64; 3],
    /// Unit vectors along x, y and z of the hand's frame.
    pub hand_axes: [[f64; 3]; 3],
}

/// A joint of an [`ArmFigure`].
#[derive(Debug, Clone, PartialEq)]
pub struct ArmJoint {
    /// Shown in the legend.
    pub name: String,
    /// A point on its axis, at which links meet.
    pub origin_m: [f64; 3],
    /// Unit vector along its axis.
    pub axis: [f64; 3],
}

/// The two views. Each shows one horizontal axis of the world, and z.
const VIEWS: [(&str, usize, &str); 2] = [("Side", 0, "x (m)"), ("Front", 1, "y (m)")];

/// Space left of a plot for its tick labels, in pixels. Only the left plot has a heading of z.
const TICKS_WIDTH: f64 = 46.0;
const PLOTS_TOP: f64 = 64.0;
const PLOTS_BOTTOM: f64 = 50.0;
const PLOTS_GAP: f64 = 24.0;
const LEGEND_GAP: f64 = 20.0;
const LEGEND_WIDTH: f64 = 180.0;
const LEGEND_ROW: f64 = 20.0;
/// Space around the arm, relative to its largest extent.
const AROUND: f64 = 0.14;
/// Length of the hand's axes, and half the length of a joint's axis, relative to the largest extent.
const HAND_AXIS: f64 = 0.13;
const JOINT_AXIS: f64 = 0.05;
/// Names and colours of the hand's axes.
const HAND_AXES: [(&str, theme::Rgb); 3] =
    [("x", theme::PALETTE[1]), ("y", theme::PALETTE[2]), ("z", theme::PALETTE[0])];
/// Smallest extent that is drawn, m.
const SMALLEST_M: f64 = 0.01;

impl ArmFigure {
    /// Draws the arm from its side, along y, and from its front, against x, as one self-contained `<svg>` element.
    /// Both views have one scale. Joints are dots with a stroke along their axes, and numbers that a legend explains.
    ///
    /// # Errors
    ///
    /// [`FigureError::Size`], and [`FigureError::Range`] for coordinates that are not finite.
    pub fn to_svg(&self, size: Size) -> Result<String, FigureError> {
        size.check()?;
        let scene = Scene::new(self, size)?;
        let mut body = String::new();
        for plot in &scene.plots {
            self.draw(&scene, plot, &mut body);
        }
        self.draw_legend(&scene, &mut body);
        let title = text::xml(&self.title);
        let shown = text::fit(&self.title, TITLE_FONT_SIZE, f64::from(size.width) - 2.0 * MARGIN);
        let heading = Words { x: MARGIN, y: 26.0, size: TITLE_FONT_SIZE, anchor: "start" };
        heading.write(&shown, theme::INK, &mut body);
        let Size { width, height } = size;
        let ground = theme::hex(theme::GROUND);
        Ok(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"100%\" role=\"img\" \
             font-family=\"system-ui, sans-serif\" stroke-linecap=\"round\" stroke-linejoin=\"round\">\n\
             <title>{title}</title>\n<desc>{}</desc>\n<style>{}</style>\n\
             <rect width=\"{width}\" height=\"{height}\" rx=\"8\" fill=\"{ground}\"/>\n{body}</svg>\n",
            text::xml(&self.described()),
            theme::style(),
        ))
    }

    /// The positions in words.
    fn described(&self) -> String {
        let point = |[x, y, z]: [f64; 3]| format!("{x:.3} {y:.3} {z:.3}");
        let mut words = format!("An arm that stands at {} m.", point(self.base_m));
        for joint in &self.joints {
            let (origin, axis) = (point(joint.origin_m), point(joint.axis));
            // Writing to a string cannot fail.
            let _ = write!(words, " Joint {} at {origin} m turns about {axis}.", joint.name);
        }
        let _ = write!(words, " The hand is at {} m.", point(self.hand_m));
        words
    }

    /// The points that links connect.
    fn points(&self) -> impl Iterator<Item = [f64; 3]> {
        let joints = self.joints.iter().map(|joint| joint.origin_m);
        [self.base_m].into_iter().chain(joints).chain([self.hand_m])
    }

    fn draw(&self, scene: &Scene, plot: &Plot, body: &mut String) {
        plot.draw_frame(body);
        let path: Vec<String> = self
            .points()
            .map(|point| {
                let (x, y) = plot.place(point);
                format!("{x:.1},{y:.1}")
            })
            .collect();
        let link = theme::hex(theme::SHADE);
        let _ = writeln!(
            body,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{link}\" stroke-width=\"7\" stroke-opacity=\"0.55\"/>",
            path.join(" ")
        );
        let (x, y) = plot.place(self.base_m);
        let base = theme::hex(theme::INK);
        let _ = writeln!(
            body,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"14\" height=\"14\" rx=\"2\" fill=\"{base}\"/>",
            x - 7.0,
            y - 7.0
        );
        for (axis, (name, color)) in self.hand_axes.into_iter().zip(HAND_AXES) {
            let end = moved(self.hand_m, axis, HAND_AXIS * scene.extent_m);
            let tip = moved(self.hand_m, axis, (HAND_AXIS + 0.03) * scene.extent_m);
            let ([x, y], [to_x, to_y]) = (plot.place(self.hand_m).into(), plot.place(end).into());
            line([x, y, to_x, to_y], color, 2.5, body);
            let (x, y) = plot.place(tip);
            if (to_x - x).hypot(to_y - y) > 2.0 {
                Words { x, y: y + 4.0, size: FONT_SIZE, anchor: "middle" }.write(name, color, body);
            }
        }
        for joint in &self.joints {
            let [from, to] = [-1.0, 1.0].map(|side| {
                plot.place(moved(joint.origin_m, joint.axis, side * JOINT_AXIS * scene.extent_m))
            });
            line([from.0, from.1, to.0, to.1], theme::INK, 1.5, body);
        }
        for joint in &self.joints {
            let (x, y) = plot.place(joint.origin_m);
            let (ground, ink) = (theme::hex(theme::GROUND), theme::hex(theme::INK));
            let _ = writeln!(
                body,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"{ground}\" stroke=\"{ink}\" stroke-width=\"2\"/>"
            );
        }
        self.draw_numbers(scene, plot, body);
    }

    /// Writes the numbers of the joints beside their dots. Dots at one place share a text.
    fn draw_numbers(&self, scene: &Scene, plot: &Plot, body: &mut String) {
        const TOGETHER: f64 = 10.0;

        let mut groups: Vec<(f64, f64, String)> = Vec::new();
        for (number, joint) in (1..).zip(&self.joints) {
            let (x, y) = plot.place(joint.origin_m);
            let near = groups.iter_mut().find(|group| (group.0 - x).hypot(group.1 - y) < TOGETHER);
            match near {
                Some((_, _, label)) => {
                    let _ = write!(label, ", {number}");
                }
                None => groups.push((x, y, number.to_string())),
            }
        }
        let mut obstacles = scene.obstacles(self, plot);
        for (x, y, label) in &groups {
            let half_width = 0.5 * text::width(label, FONT_SIZE);
            let aside = half_width + 12.0;
            let places = [(aside, 0.0), (-aside, 0.0), (0.0, -16.0), (0.0, 16.0)]
                .into_iter()
                .chain([(aside, -14.0), (-aside, -14.0), (aside, 14.0), (-aside, 14.0)]);
            let crowd = |(dx, dy): &(f64, f64)| {
                let hits = |(px, py): &&(f64, f64)| {
                    (px - x - dx).abs() < half_width + 4.0 && (py - y - dy).abs() < 9.0
                };
                obstacles.iter().filter(hits).count()
            };
            let Some((dx, dy)) = places.min_by_key(crowd) else { continue };
            Words { x: x + dx, y: y + dy + 4.0, size: FONT_SIZE, anchor: "middle" }.write(
                label,
                theme::INK,
                body,
            );
            // Weighs as much as a link.
            obstacles.extend([(x + dx, y + dy); 8]);
        }
    }

    fn draw_legend(&self, scene: &Scene, body: &mut String) {
        let names: Vec<&str> = self.joints.iter().map(|joint| joint.name.as_str()).collect();
        let room = f64::from(scene.size.width) - MARGIN - scene.legend_left - 22.0;
        let mut y = PLOTS_TOP + 8.0;
        for (number, name) in (1..).zip(text::fit_names(&names, FONT_SIZE, room)) {
            let x = scene.legend_left;
            Words { x: x + 12.0, y, size: FONT_SIZE, anchor: "end" }.write(
                &format!("{number}"),
                theme::INK,
                body,
            );
            Words { x: x + 22.0, y, size: FONT_SIZE, anchor: "start" }.write(
                &name,
                theme::INK,
                body,
            );
            y += LEGEND_ROW;
        }
        let square = theme::hex(theme::INK);
        let left = scene.legend_left + 3.0;
        let _ = writeln!(
            body,
            "<rect x=\"{left:.1}\" y=\"{:.1}\" width=\"9\" height=\"9\" rx=\"1.5\" fill=\"{square}\"/>",
            y - 8.0
        );
        Words { x: scene.legend_left + 22.0, y, size: FONT_SIZE, anchor: "start" }.write(
            "base",
            theme::INK,
            body,
        );
        y += LEGEND_ROW;
        for ((name, color), x) in HAND_AXES.into_iter().zip([-4.0, 4.0, 12.0]) {
            Words { x: scene.legend_left + x, y, size: FONT_SIZE, anchor: "end" }
                .write(name, color, body);
        }
        Words { x: scene.legend_left + 22.0, y, size: FONT_SIZE, anchor: "start" }.write(
            "hand",
            theme::INK,
            body,
        );
    }
}

/// The places of both plots.
struct Scene {
    size: Size,
    plots: Vec<Plot>,
    /// The arm's largest extent.
    extent_m: f64,
    legend_left: f64,
}

impl Scene {
    fn new(arm: &ArmFigure, size: Size) -> Result<Self, FigureError> {
        let mut low = arm.base_m;
        let mut high = arm.base_m;
        for point in arm.points() {
            for axis in 0..3 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
                // `min` and `max` pass over NaN.
                if !point[axis].is_finite() {
                    return Err(FigureError::Range {
                        label: ["x", "y", "z"][axis].to_owned(),
                        low: point[axis],
                        high: point[axis],
                        allowed: "coordinates of an arm must be finite",
                    });
                }
            }
        }
        let extents = [0, 1, 2].map(|axis| high[axis] - low[axis]);
        let extent_m = extents.into_iter().fold(SMALLEST_M, f64::max);
        // The hand's axes may point out of the arm.
        let spans = extents.map(|extent| extent + 2.0 * (AROUND + HAND_AXIS) * extent_m);

        let (width, height) = (f64::from(size.width), f64::from(size.height));
        let legend_width = LEGEND_WIDTH.min(0.25 * width);
        let legend_left = width - MARGIN - legend_width;
        let left = MARGIN + TICKS_WIDTH;
        let room = legend_left - LEGEND_GAP - left - PLOTS_GAP;
        let plot_height = height - PLOTS_TOP - PLOTS_BOTTOM;
        let pixels_per_m = (room / (spans[0] + spans[1])).min(plot_height / spans[2]);
        // Room that is left over goes to both plots.
        let spare = 0.5 * (room - pixels_per_m * (spans[0] + spans[1]));
        let mut at = left;
        let mut plots = Vec::with_capacity(VIEWS.len());
        for (title, axis, heading) in VIEWS {
            let plot_width = pixels_per_m * spans[axis] + spare;
            plots.push(Plot {
                title,
                axis,
                heading,
                left: at,
                width: plot_width,
                height: plot_height,
                pixels_per_m,
                center_m: [axis, 2].map(|axis| 0.5 * (low[axis] + high[axis])),
            });
            at += plot_width + PLOTS_GAP;
        }
        Ok(Self { size, plots, extent_m, legend_left })
    }

    /// Points along everything that a label should not cover.
    fn obstacles(&self, arm: &ArmFigure, plot: &Plot) -> Vec<(f64, f64)> {
        const STEPS: u32 = 24;

        let mut segments: Vec<([f64; 3], [f64; 3])> =
            arm.points().zip(arm.points().skip(1)).collect();
        segments.extend(
            arm.hand_axes
                .map(|axis| (arm.hand_m, moved(arm.hand_m, axis, HAND_AXIS * self.extent_m))),
        );
        segments.extend(arm.joints.iter().map(|joint| {
            let [from, to] = [-1.0, 1.0]
                .map(|side| moved(joint.origin_m, joint.axis, side * JOINT_AXIS * self.extent_m));
            (from, to)
        }));
        let along = |(from, to): ([f64; 3], [f64; 3])| {
            (0..=STEPS).map(move |step| {
                let share = f64::from(step) / f64::from(STEPS);
                plot.place([0, 1, 2].map(|axis| from[axis] + share * (to[axis] - from[axis])))
            })
        };
        segments.into_iter().flat_map(along).collect()
    }
}

/// One view of the arm.
struct Plot {
    title: &'static str,
    /// The horizontal axis: 0 for x, 1 for y.
    axis: usize,
    heading: &'static str,
    left: f64,
    width: f64,
    height: f64,
    pixels_per_m: f64,
    /// Horizontally and vertically.
    center_m: [f64; 2],
}

impl Plot {
    /// The pixel of a point of the world.
    fn place(&self, point: [f64; 3]) -> (f64, f64) {
        let [across, up] = [point[self.axis] - self.center_m[0], point[2] - self.center_m[1]];
        (
            self.left + 0.5 * self.width + self.pixels_per_m * across,
            PLOTS_TOP + 0.5 * self.height - self.pixels_per_m * up,
        )
    }

    fn ticks(&self, center_m: f64, pixels: f64) -> Vec<Tick> {
        const PIXELS_PER_TICK: f64 = 64.0;

        let half = 0.5 * pixels / self.pixels_per_m;
        let most = [12, 8, 6, 4, 3, 2, 1]
            .into_iter()
            .find(|most| f64::from(*most) * PIXELS_PER_TICK <= pixels)
            .unwrap_or(1);
        ticks::candidates(Scale::Linear, center_m - half, center_m + half, most).swap_remove(0)
    }

    /// Grid, axes, tick labels, heading and title.
    fn draw_frame(&self, body: &mut String) {
        let [center, center_up] = self.center_m;
        let (right, bottom) = (self.left + self.width, PLOTS_TOP + self.height);
        let words = |x: f64, y: f64, anchor| Words { x, y, size: FONT_SIZE, anchor };
        for tick in self.ticks(center, self.width) {
            let x = self.left + 0.5 * self.width + self.pixels_per_m * (tick.value - center);
            line([x, PLOTS_TOP, x, bottom], theme::FINE_GRID, 1.0, body);
            words(x, bottom + 18.0, "middle").write(&tick.label, theme::INK, body);
        }
        let is_left = self.axis == VIEWS[0].1;
        for tick in self.ticks(center_up, self.height) {
            let y = PLOTS_TOP + 0.5 * self.height - self.pixels_per_m * (tick.value - center_up);
            line([self.left, y, right, y], theme::FINE_GRID, 1.0, body);
            if is_left {
                words(self.left - 8.0, y + 4.0, "end").write(&tick.label, theme::INK, body);
            }
        }
        line([self.left, bottom, right, bottom], theme::AXIS, 1.0, body);
        line([self.left, PLOTS_TOP, self.left, bottom], theme::AXIS, 1.0, body);
        let middle = self.left + 0.5 * self.width;
        words(middle, bottom + 38.0, "middle").write(self.heading, theme::INK, body);
        words(middle, PLOTS_TOP - 10.0, "middle").write(self.title, theme::INK, body);
        if is_left {
            words(self.left - 8.0, PLOTS_TOP - 10.0, "end").write("z (m)", theme::INK, body);
        }
    }
}

/// A text and where it stands.
struct Words {
    x: f64,
    /// The line on which letters stand.
    y: f64,
    size: f64,
    anchor: &'static str,
}

impl Words {
    /// Writes them with a rim in the colour of the ground, so that they can be read on lines.
    fn write(&self, words: &str, color: theme::Rgb, body: &mut String) {
        let Self { x, y, size, anchor } = self;
        let (color, ground) = (theme::hex(color), theme::hex(theme::GROUND));
        let _ = writeln!(
            body,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" text-anchor=\"{anchor}\" fill=\"{color}\" \
             stroke=\"{ground}\" stroke-width=\"3\" paint-order=\"stroke\">{}</text>",
            text::xml(words)
        );
    }
}

fn line([from_x, from_y, to_x, to_y]: [f64; 4], color: theme::Rgb, width: f64, body: &mut String) {
    let color = theme::hex(color);
    let _ = writeln!(
        body,
        "<line x1=\"{from_x:.1}\" y1=\"{from_y:.1}\" x2=\"{to_x:.1}\" y2=\"{to_y:.1}\" stroke=\"{color}\" \
         stroke-width=\"{width}\"/>"
    );
}

fn moved(point: [f64; 3], direction: [f64; 3], distance: f64) -> [f64; 3] {
    [0, 1, 2].map(|axis| point[axis] + distance * direction[axis])
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 860, height: 480 };

    fn arm() -> ArmFigure {
        let joint = |name: &str, origin_m, axis| ArmJoint { name: name.to_owned(), origin_m, axis };
        ArmFigure {
            title: "a <lamp>".to_owned(),
            base_m: [0.0; 3],
            joints: vec![
                joint("turn & tilt", [0.0, 0.0, 0.1], [0.0, 0.0, 1.0]),
                joint("hip", [0.0, 0.0, 0.102], [0.0, 1.0, 0.0]),
                joint("knee", [0.4, 0.0, 0.5], [0.0, 1.0, 0.0]),
            ],
            hand_m: [0.7, 0.1, 0.4],
            hand_axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        }
    }

    #[test]
    fn joints_have_numbers_that_the_legend_explains_and_those_at_one_place_share_a_text() {
        let svg = arm().to_svg(SIZE).unwrap();
        assert!(svg.contains("<title>a &lt;lamp&gt;</title>"), "{svg}");
        assert!(svg.contains(">turn &amp; tilt</text>") && svg.contains(">knee</text>"), "{svg}");
        // In both views.
        assert_eq!(svg.matches(">1, 2</text>").count(), 2, "{svg}");
        assert_eq!(svg.matches("<circle").count(), 6);
        assert!(svg.contains(">hand</text>") && svg.contains(">base</text>"));
        assert!(!svg.contains(" id="), "several drawings may stand in one page");
    }

    #[test]
    fn both_views_have_one_scale_and_everything_is_inside() {
        for size in [SIZE, Size { width: 400, height: 900 }, Size { width: 1200, height: 300 }] {
            let scene = Scene::new(&arm(), size).unwrap();
            let [side, front] = &scene.plots[..] else { panic!("two views") };
            assert_eq!(side.pixels_per_m, front.pixels_per_m);
            for plot in [side, front] {
                for point in arm().points() {
                    let (x, y) = plot.place(point);
                    assert!((plot.left..=plot.left + plot.width).contains(&x));
                    assert!((PLOTS_TOP..=PLOTS_TOP + plot.height).contains(&y));
                }
            }
            assert!(front.left + front.width < scene.legend_left);
        }
    }

    #[test]
    fn a_point_is_an_arm_and_a_coordinate_that_is_not_finite_is_refused() {
        let point = ArmFigure { joints: Vec::new(), hand_m: [0.0; 3], ..arm() };
        assert!(point.to_svg(SIZE).is_ok());
        let broken = ArmFigure { hand_m: [0.0, f64::NAN, 0.0], ..arm() };
        assert!(matches!(broken.to_svg(SIZE), Err(FigureError::Range { .. })));
        assert!(arm().to_svg(Size { width: 10, height: 10 }).is_err());
    }
}
