// Draws a figure for a narrow screen: its plots as wide as the screen, and the names of its curves in rows below them.
// The server's drawings are 760 pixels wide, of which a phone would show less than half.

const MARGIN = 14;
const AXIS = 44; // Tick labels and the heading below a plot.
const ROW = 20;
const GAP = 16;
const SMALLEST_TITLE = 10; // CSS pixels.

/** The widest region, in pixels, in which a figure is drawn anew. */
export const NARROW = 600;

/** The parts of a drawing that belong to `plot` and to no plot inside it. */
function own(plot, selector) {
  return [...plot.svg.querySelectorAll(selector)].filter((it) => it.closest("svg:not(.data)") === plot.svg);
}

/** Moves the names of a plot's curves below it. Gives the lower edge of the last row. */
function placeKeys(plot, width) {
  let [left, middle] = [MARGIN, plot.bottom + AXIS + ROW / 2];
  const keys = own(plot, ".key");
  for (const key of keys) {
    // A key has the units of the group around it, which are smaller than the drawing's.
    const [box, scale] = [key.getBBox(), key.parentElement.transform.baseVal.consolidate()?.matrix.a ?? 1];
    const wide = box.width * scale;
    if (left > MARGIN && left + wide > width - MARGIN) [left, middle] = [MARGIN, middle + ROW];
    const [across, down] = [left / scale - box.x, middle / scale - (box.y + box.height / 2)];
    key.setAttribute("transform", `translate(${across.toFixed(1)} ${down.toFixed(1)})`);
    left += wide + GAP;
  }
  return keys.length > 0 ? middle + ROW / 2 : plot.bottom + AXIS;
}

/** Makes the title of a plot as small as its room asks for, down to `SMALLEST_TITLE`. */
function fitTitle(plot, room) {
  for (const title of own(plot, "text[font-weight='bold']")) {
    const scale = title.closest("g[transform]")?.transform.baseVal.consolidate()?.matrix.a ?? 1;
    const size = Number(title.getAttribute("font-size"));
    const share = Math.min(1, room / (title.getBBox().width * scale));
    title.setAttribute("font-size", Math.max(share * size, SMALLEST_TITLE / scale));
  }
}

/** Gives a drawing and its `plots` the width `width`, in pixels. */
export function narrow(svg, plots, width) {
  let top = 0;
  for (const plot of plots) {
    plot.fit(width - MARGIN - 4);
    fitTitle(plot, width - 2 * MARGIN);
    const height = placeKeys(plot, width) + MARGIN;
    plot.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    for (const ground of own(plot, ":scope > rect")) {
      ground.setAttribute("width", width);
      ground.setAttribute("height", height);
    }
    if (plot.svg !== svg) {
      for (const [name, value] of Object.entries({ y: top, width, height })) plot.svg.setAttribute(name, value);
    }
    top += height;
  }
  svg.setAttribute("viewBox", `0 0 ${width} ${top}`);
  svg.style.maxWidth = `${width}px`;
  for (const plot of plots) plot.draw();
}
