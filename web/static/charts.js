// Makes figures answer: values under the pointer, a part of the x axis drawn larger, curves switched off, a PNG,
// and an SVG and a table of a drawing for which the server has no address.
// The server's drawings hold their numbers in <metadata> (crates/figures/src/numbers.rs). Without this script, and of drawings
// without numbers, they stay pictures. The server's elements are never changed: what is added stands beside them, in
// `.chart`, and `data-chart` on the figure hides the picture. On a narrow screen all is drawn anew at its width (narrow.js).

import { NARROW, narrow } from "./narrow.js";

const SVG = "http://www.w3.org/2000/svg";
const CLOSE = 24; // A curve whose nearest point is further away, in pixels, is not read.
const NARROWEST = 8; // Less than that is a click.
const PNG_SCALE = 2;

const charts = new WeakMap();

function element(name, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

function button(text, act) {
  const made = document.createElement("button");
  made.type = "button";
  made.className = "plain";
  made.textContent = text;
  made.addEventListener("click", act);
  return made;
}

/** Five significant digits; large and small numbers with an exponent. */
function short(value) {
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-4 || size >= 1e7)) return value.toExponential(3);
  return String(Number(value.toPrecision(5)));
}

const scaled = (axis, value) => (axis.log ? Math.log10(value) : value);
const unscaled = (axis, value) => (axis.log ? 10 ** value : value);

/** About `count` round values between the ends of an axis. */
function ticks(axis, count) {
  const [low, high] = [axis.low, axis.high].map((end) => scaled(axis, end));
  const found = [];
  if (axis.log && high - low >= 1) {
    const every = Math.ceil((high - low) / count);
    for (let at = Math.ceil(low); at <= high; at += every) found.push(10 ** at);
    return found;
  }
  const [from, to] = [axis.low, axis.high];
  const power = 10 ** Math.floor(Math.log10((to - from) / count));
  const step = [1, 2, 5, 10].map((it) => it * power).find((it) => (to - from) / it <= count);
  for (let at = Math.ceil(from / step) * step; at <= to; at += step) found.push(Number(at.toPrecision(12)));
  return found;
}

/** One figure of a drawing: its element, its numbers, and the part of them that is drawn. */
class Plot {
  constructor(svg, numbers) {
    this.svg = svg;
    [this.left, this.top, this.right, this.bottom] = numbers.plot;
    this.whole = { x: numbers.x, y: numbers.y };
    this.x = numbers.x;
    this.y = numbers.y;
    this.bands = numbers.bands ?? [];
    this.isNarrow = false;
    let x = [];
    this.series = numbers.series.map((told) => {
      x = told.x ?? x;
      return { ...told, x, isOff: false };
    });
  }

  atX(value) {
    const [low, high] = [this.x.low, this.x.high].map((end) => scaled(this.x, end));
    return this.left + ((scaled(this.x, value) - low) / (high - low)) * (this.right - this.left);
  }

  atY(value) {
    const [low, high] = [this.y.low, this.y.high].map((end) => scaled(this.y, end));
    return this.bottom - ((scaled(this.y, value) - low) / (high - low)) * (this.bottom - this.top);
  }

  /** The value of x at a place. */
  valueAt(place) {
    const [low, high] = [this.x.low, this.x.high].map((end) => scaled(this.x, end));
    const share = (place - this.left) / (this.right - this.left);
    return unscaled(this.x, low + share * (high - low));
  }

  get isZoomed() {
    return this.x !== this.whole.x;
  }

  /** Whether the server's axes and curves do not show what is wanted. */
  get isOwn() {
    return this.isZoomed || this.isNarrow;
  }

  /** Ends the plot at `right`, in the units of the drawing. */
  fit(right) {
    this.right = right;
    this.isNarrow = true;
  }

  get shown() {
    return this.series.filter(({ isOff }) => !isOff);
  }

  /** The index of the point of a series that is nearest to a value of x; -1 without points. */
  nearest({ x }, value) {
    let [best, least] = [-1, Infinity];
    for (let k = 0; k < x.length; k += 1) {
      if (x[k] === null) continue;
      const away = Math.abs(scaled(this.x, x[k]) - scaled(this.x, value));
      if (away < least) [best, least] = [k, away];
    }
    return best;
  }

  /** Every x with a point of a shown series, rising. */
  places() {
    const all = new Set(this.shown.flatMap(({ x }) => x.filter((it) => it !== null)));
    const inside = [...all].filter((it) => it >= this.x.low && it <= this.x.high);
    return inside.sort((a, b) => a - b);
  }

  /** Shows x from `low` to `high`, and the y that is there. `null` shows everything. */
  zoom(range) {
    if (range === null) {
      [this.x, this.y] = [this.whole.x, this.whole.y];
    } else {
      this.x = { ...this.whole.x, low: range[0], high: range[1] };
      this.y = { ...this.whole.y, ...this.extent() };
    }
    this.draw();
  }

  /** The ends of y for the part of x that is shown, with some room. */
  extent() {
    let [low, high] = [Infinity, -Infinity];
    for (const { x, y, low: lows, high: highs } of this.shown) {
      for (let k = 0; k < x.length; k += 1) {
        if (x[k] === null || x[k] < this.x.low || x[k] > this.x.high) continue;
        for (const value of [y[k], lows?.[k] ?? y[k], highs?.[k] ?? y[k]]) {
          if (this.whole.y.log && value <= 0) continue;
          [low, high] = [Math.min(low, value), Math.max(high, value)];
        }
      }
    }
    if (low > high) return {};
    const axis = this.whole.y;
    const room = 0.05 * (scaled(axis, high) - scaled(axis, low)) || Math.abs(0.05 * high) || 1;
    return { low: unscaled(axis, scaled(axis, low) - room), high: unscaled(axis, scaled(axis, high) + room) };
  }

  /** Draws the curves and the axes again, or shows the server's if everything is shown. */
  draw() {
    this.svg.querySelector(":scope > .zoomed")?.remove();
    for (const part of this.svg.querySelectorAll(".frame, svg.data")) {
      if (part.closest("svg:not(.data)") === this.svg) part.style.display = this.isOwn ? "none" : "";
    }
    this.svg.querySelectorAll("[data-series]").forEach((part) => {
      if (part.closest("svg:not(.data)") !== this.svg) return;
      const { isOff } = this.series[part.dataset.series];
      if (part.classList.contains("key")) part.style.opacity = isOff ? 0.35 : "";
      else part.style.display = isOff ? "none" : "";
    });
    if (!this.isOwn) return;
    const { left, top, right, bottom } = this;
    const lines = element("svg", {
      x: left, y: top, width: right - left, height: bottom - top,
      viewBox: `${left} ${top} ${right - left} ${bottom - top}`,
    });
    for (const series of this.shown) lines.append(...this.curve(series));
    this.svg.append(element("g", { class: "zoomed" }, ...this.axes(), lines));
  }

  *axes() {
    const { left, top, right, bottom } = this;
    const label = { fill: "#222222", "font-size": 12, "font-family": "system-ui, sans-serif" };
    for (const { from, to, label: name } of this.bands) {
      const [low, high] = [from, to].map((end) => Math.max(left, Math.min(this.atX(end), right)));
      if (low === high) continue;
      yield element("rect", { x: low, y: top, width: high - low, height: bottom - top, fill: "#808080", opacity: 0.22 });
      // A name that is wider than its band would run into the next one's.
      if (name.length * 6.5 > high - low) continue;
      yield element("text", { ...label, x: (low + high) / 2, y: top - 5, "text-anchor": "middle" }, name);
    }
    for (const value of ticks(this.x, Math.max(2, Math.min(8, Math.floor((right - left) / 60))))) {
      const x = this.atX(value);
      yield element("path", { d: `M${x} ${top}V${bottom}`, stroke: "#D6D6D6" });
      yield element("text", { ...label, x, y: bottom + 17, "text-anchor": "middle" }, short(value));
    }
    for (const value of ticks(this.y, 6)) {
      const y = this.atY(value);
      yield element("path", { d: `M${left} ${y}H${right}`, stroke: "#D6D6D6" });
      yield element("text", { ...label, x: left - 7, y: y + 4, "text-anchor": "end" }, short(value));
    }
    yield element("path", { d: `M${left} ${top}V${bottom}H${right}`, fill: "none", stroke: "#555555" });
    const heading = ({ label: name, unit }) => (unit ? `${name} (${unit})` : name);
    const middle = (left + right) / 2;
    yield element("text", { ...label, x: middle, y: bottom + 36, "text-anchor": "middle" }, heading(this.x));
    const turned = `rotate(-90 20 ${(top + bottom) / 2})`;
    yield element("text", {
      ...label, x: 20, y: (top + bottom) / 2 + 4, transform: turned, "text-anchor": "middle",
    }, heading(this.y));
  }

  *curve({ x, y, low, high, colour, stroke, markers }) {
    const place = (k, value) => `${this.atX(x[k]).toFixed(2)} ${this.atY(value).toFixed(2)}`;
    const runs = [];
    x.forEach((value, k) => {
      if (value === null) return;
      if (k === 0 || x[k - 1] === null) runs.push([]);
      runs.at(-1).push(k);
    });
    for (const run of runs) {
      const within = run.filter((k) => low?.[k] != null);
      if (within.length > 1 && !markers) {
        const edge = [...within.map((k) => place(k, high[k])), ...within.reverse().map((k) => place(k, low[k]))];
        yield element("path", { d: `M${edge.join("L")}Z`, fill: colour, "fill-opacity": 0.18 });
      }
    }
    const wide = { wide: { "stroke-width": 6, opacity: 0.35 }, faint: { "stroke-width": 1, opacity: 0.45 } }[stroke]
      ?? { "stroke-width": 2 };
    const dashes = stroke === "dashed" ? { "stroke-dasharray": "7 4" } : {};
    for (const run of runs) {
      const d = `M${run.map((k) => place(k, y[k])).join("L")}`;
      yield element("path", { d, fill: "none", stroke: colour, "stroke-linejoin": "round", ...wide, ...dashes });
      for (const k of markers || run.length === 1 ? run : []) {
        const [cx, cy] = place(k, y[k]).split(" ");
        if (low?.[k] != null) {
          yield element("path", { d: `M${place(k, low[k])}L${place(k, high[k])}`, stroke: colour });
        }
        yield element("circle", { cx, cy, r: 3.5, fill: colour });
      }
    }
  }
}

/** A drawing that answers. */
class Chart {
  constructor(figure, svg) {
    this.figure = figure;
    this.region = figure.querySelector(".scroll");
    this.svg = svg;
    this.plots = [];
    for (const metadata of svg.querySelectorAll("metadata")) {
      this.plots.push(new Plot(metadata.parentElement, JSON.parse(metadata.textContent)));
    }
    // A picture has no parts that the keyboard could reach.
    for (const it of [svg, ...svg.querySelectorAll("[role='img']")]) it.setAttribute("role", "group");
    this.reading = document.createElement("div");
    this.reading.className = "reading";
    this.reading.setAttribute("role", "status");
    this.reading.hidden = true;
    this.cursor = element("path", { class: "cursor" });
    this.dots = element("g", {});
    this.selected = element("rect", { class: "selected" });
    this.whole = button("Whole range", () => this.zoom(null));
    this.whole.hidden = true;
    this.tools = document.createElement("div");
    this.tools.className = "tools added";
    this.tools.append(this.whole, button("PNG", () => this.png()));
    // A drawing that stands in the page has no links to files beside it.
    if (figure.querySelector(".scroll > svg")) {
      this.tools.append(button("SVG", () => this.svgFile()), button("CSV", () => this.csvFile()));
    }
    this.box = document.createElement("div");
    this.box.className = "chart added";
    this.box.append(svg, this.reading);
    this.region.append(this.box);
    figure.append(this.tools);
    figure.dataset.chart = "";
    const room = this.region.clientWidth;
    if (this.plots.length > 0 && room > 0 && room < NARROW) {
      this.box.classList.add("narrow");
      narrow(svg, this.plots, room);
    }
    this.listen();
  }

  listen() {
    this.box.addEventListener("pointermove", (event) => this.move(event));
    // A finger that is lifted leaves, too, and what it read stays.
    this.box.addEventListener("pointerleave", (event) => event.pointerType !== "touch" && this.leave());
    this.box.addEventListener("pointerdown", (event) => this.press(event));
    this.box.addEventListener("pointerup", (event) => this.release(event));
    this.box.addEventListener("pointercancel", () => this.drop());
    this.box.addEventListener("dblclick", () => this.zoom(null));
    this.region.addEventListener("keydown", (event) => this.key(event));
    for (const plot of this.plots) {
      for (const key of plot.svg.querySelectorAll(":scope > g > .key, :scope > g > g > .key")) {
        const series = plot.series[key.dataset.series];
        key.setAttribute("tabindex", "0");
        key.setAttribute("role", "switch");
        key.setAttribute("aria-checked", "true");
        key.setAttribute("aria-label", series.name);
        const toggle = () => this.toggle(series.name);
        key.addEventListener("click", toggle);
        key.addEventListener("keydown", (event) => {
          if (event.key !== "Enter" && event.key !== " ") return;
          event.preventDefault();
          toggle();
        });
      }
    }
  }

  /** The plot below the pointer, and the place there in its own units. */
  under({ clientX, clientY }) {
    for (const plot of this.plots) {
      const place = new DOMPoint(clientX, clientY).matrixTransform(plot.svg.getScreenCTM().inverse());
      const { left, right, top, bottom } = plot;
      if (place.x >= left - 4 && place.x <= right + 4 && place.y >= top && place.y <= bottom) return { plot, place };
    }
    return null;
  }

  move(event) {
    const found = this.under(event);
    if (this.drag) return this.stretch(event);
    if (!found) return this.leave();
    this.read(found.plot, found.plot.valueAt(found.place.x));
  }

  leave() {
    this.reading.hidden = true;
    this.cursor.remove();
    this.dots.remove();
    this.at = null;
  }

  /** Shows the values of all curves of a plot at the point that is nearest to `value`. */
  read(plot, value) {
    let [x, least] = [null, Infinity];
    for (const series of plot.shown) {
      const k = plot.nearest(series, value);
      if (k < 0 || series.x[k] < plot.x.low || series.x[k] > plot.x.high) continue;
      const away = Math.abs(plot.atX(series.x[k]) - plot.atX(value));
      if (away < least) [x, least] = [series.x[k], away];
    }
    if (x === null) return this.leave();
    this.at = { plot, x };
    const unit = (axis) => (axis.unit ? axis.unit.replace(/^(?!°)/, " ") : "");
    const lines = [`${plot.x.label}: ${short(x)}${unit(plot.x)}`];
    const dots = [];
    for (const series of plot.shown.filter(({ stroke }) => stroke !== "faint")) {
      const k = plot.nearest(series, x);
      if (k < 0 || Math.abs(plot.atX(series.x[k]) - plot.atX(x)) > CLOSE) continue;
      const ends = series.low?.[k] == null ? "" : ` (${short(series.low[k])} to ${short(series.high[k])})`;
      lines.push([series.colour, series.name, `${short(series.y[k])}${unit(plot.y)}${ends}`]);
      const y = plot.atY(series.y[k]);
      if (y >= plot.top - 1 && y <= plot.bottom + 1) {
        dots.push(element("circle", { cx: plot.atX(series.x[k]), cy: y, r: 4, fill: series.colour, class: "dot" }));
      }
    }
    this.show(plot, x, lines, dots);
  }

  show(plot, x, [first, ...lines], dots) {
    const title = document.createElement("strong");
    title.textContent = first;
    const rows = lines.map(([colour, name, value]) => {
      const row = document.createElement("div");
      // A figure's style sheet gives the dark page's colour to this attribute.
      const swatch = element("svg", { width: 10, height: 10, viewBox: "0 0 10 10" }, element("rect", { width: 10, height: 10, fill: colour }));
      const said = document.createElement("span");
      said.textContent = name;
      const number = document.createElement("b");
      number.textContent = value;
      row.append(swatch, said, number);
      return row;
    });
    const help = document.createElement("small");
    help.textContent = "Drag to zoom in, click a name to hide it";
    this.reading.replaceChildren(title, ...rows, help);
    this.reading.hidden = false;
    this.cursor.setAttribute("d", `M${plot.atX(x)} ${plot.top}V${plot.bottom}`);
    this.dots.replaceChildren(...dots);
    plot.svg.append(this.cursor, this.dots);
    this.place(plot, x);
  }

  /** Puts the reading beside the cursor, on the side with more room. */
  place(plot, x) {
    const box = this.box.getBoundingClientRect();
    const at = new DOMPoint(plot.atX(x), plot.top).matrixTransform(plot.svg.getScreenCTM());
    const [across, down] = [at.x - box.left, at.y - box.top];
    const isLeft = across > box.width / 2;
    const { offsetWidth, offsetHeight } = this.reading;
    const left = isLeft ? across - offsetWidth - 12 : across + 12;
    this.reading.style.left = `${Math.max(0, Math.min(left, box.width - offsetWidth))}px`;
    this.reading.style.top = `${Math.max(0, Math.min(down + 6, box.height - offsetHeight))}px`;
  }

  press(event) {
    if (event.pointerType === "touch") return this.move(event);
    const found = event.button === 0 ? this.under(event) : null;
    if (!found) return;
    event.preventDefault();
    this.region.focus({ preventScroll: true });
    this.drag = { plot: found.plot, from: found.place.x, to: found.place.x };
    this.box.setPointerCapture(event.pointerId);
  }

  stretch({ clientX, clientY }) {
    const { plot, from } = this.drag;
    const place = new DOMPoint(clientX, clientY).matrixTransform(plot.svg.getScreenCTM().inverse());
    this.drag.to = Math.max(plot.left, Math.min(place.x, plot.right));
    const [left, right] = [from, this.drag.to].sort((a, b) => a - b);
    const { top, bottom } = plot;
    for (const [name, value] of Object.entries({ x: left, y: top, width: right - left, height: bottom - top })) {
      this.selected.setAttribute(name, value);
    }
    plot.svg.append(this.selected);
  }

  release() {
    if (!this.drag) return;
    const { plot, from, to } = this.drag;
    this.drop();
    if (Math.abs(to - from) < NARROWEST) return;
    this.zoom([from, to].sort((a, b) => a - b).map((place) => plot.valueAt(place)), plot);
  }

  drop() {
    this.drag = null;
    this.selected.remove();
  }

  /** Shows a range of x in every plot with the same axis, or everything. */
  zoom(range, of = null) {
    const same = ({ whole: { x } }) =>
      of === null || (x.label === of.whole.x.label && x.low === of.whole.x.low && x.high === of.whole.x.high);
    this.range = range;
    for (const plot of this.plots.filter(same)) plot.zoom(range);
    this.whole.hidden = range === null;
    this.leave();
  }

  /** Hides a curve, or shows it again, in every plot that has it. */
  toggle(name) {
    for (const plot of this.plots) {
      for (const series of plot.series.filter((it) => it.name === name)) series.isOff = !series.isOff;
      plot.draw();
      for (const key of plot.svg.querySelectorAll(".key")) {
        if (key.closest("svg") === plot.svg) {
          key.setAttribute("aria-checked", String(!plot.series[key.dataset.series].isOff));
        }
      }
    }
    this.leave();
  }

  key(event) {
    if (event.target !== this.region) return;
    if (event.key === "Escape") return this.zoom(null);
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    // What is wider than its region is scrolled by these keys.
    if (!step || this.region.scrollWidth > this.region.clientWidth + 1) return;
    event.preventDefault();
    const plot = this.at?.plot ?? this.plots[0];
    const places = plot?.places() ?? [];
    if (places.length === 0) return;
    const now = this.at ? places.indexOf(this.at.x) + step : step > 0 ? 0 : places.length - 1;
    this.read(plot, places[Math.max(0, Math.min(now, places.length - 1))]);
  }

  /** Saves the drawing as it is shown, on white. */
  async png() {
    const { width, height } = this.svg.viewBox.baseVal;
    const copy = this.svg.cloneNode(true);
    copy.querySelectorAll("style, metadata, .cursor, .dot, .selected").forEach((it) => it.remove());
    copy.setAttribute("width", width);
    copy.setAttribute("height", height);
    const url = URL.createObjectURL(new Blob([new XMLSerializer().serializeToString(copy)], { type: "image/svg+xml" }));
    const image = new Image();
    image.src = url;
    await image.decode();
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [width * PNG_SCALE, height * PNG_SCALE];
    const context = canvas.getContext("2d");
    context.fillStyle = "white";
    context.fillRect(0, 0, canvas.width, canvas.height);
    context.drawImage(image, 0, 0, canvas.width, canvas.height);
    URL.revokeObjectURL(url);
    canvas.toBlob((png) => save(png, `${name(this.figure)}.png`), "image/png");
  }

  /** Saves the drawing as it is shown, with its numbers. */
  svgFile() {
    const copy = this.svg.cloneNode(true);
    copy.querySelectorAll(".cursor, .dot, .selected").forEach((it) => it.remove());
    const text = new XMLSerializer().serializeToString(copy);
    save(new Blob([text], { type: "image/svg+xml" }), `${name(this.figure)}.svg`);
  }

  /** Saves the drawn numbers. */
  csvFile() {
    const heading = ({ label, unit }) => (unit ? `${label} (${unit})` : label);
    const rows = [["figure", "series", heading(this.plots[0].x), "y", "low", "high", "quantity of y"]];
    for (const { svg, series, y } of this.plots) {
      const title = svg.querySelector(":scope > title")?.textContent ?? "";
      for (const it of series) {
        it.x.forEach((x, at) => {
          // A break of the line has no numbers.
          if (x !== null) rows.push([title, it.name, x, it.y[at], it.low?.[at], it.high?.[at], heading(y)]);
        });
      }
    }
    const text = rows.map((row) => `${row.map(cell).join(",")}\n`).join("");
    save(new Blob([text], { type: "text/csv" }), `${name(this.figure)}.csv`);
  }

  /** What the reader changed, for the drawing that takes this one's place. */
  get state() {
    const off = this.plots.flatMap(({ series }) => series.filter(({ isOff }) => isOff).map((it) => it.name));
    const at = this.at && { plot: this.plots.indexOf(this.at.plot), x: this.at.x };
    return { range: this.range ?? null, off, at };
  }

  set state({ range, off, at }) {
    for (const series of new Set(off)) this.toggle(series);
    if (range) this.zoom(range);
    if (at && this.plots[at.plot]) this.read(this.plots[at.plot], at.x);
  }
}

function save(blob, file) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = file;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** A cell of a CSV file as the server writes it: quoted where it must be, and never a formula. */
function cell(value) {
  if (typeof value !== "string") return String(value ?? "");
  const text = /^[=+\-@\t\r]/.test(value) ? `'${value}` : value;
  return /[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/** A name for a file of the figure. */
function name(figure) {
  const address = figure.querySelector("img")?.getAttribute("src")?.split(/[?#]/)[0].split("/").at(-1);
  const title = figure.querySelector("svg > title")?.textContent;
  return (address?.replace(/\.svg$/, "") || title || "figure").replaceAll(/[^\w.-]+/g, "-");
}

/** The server's drawing of a figure: the one in the page, or the one that its picture shows. */
async function drawing(figure) {
  const inline = figure.querySelector(".scroll > svg");
  if (inline) return inline.cloneNode(true);
  const image = figure.querySelector(".scroll > img");
  if (!image) return null;
  const response = await fetch(image.src);
  if (!response.ok) return null;
  const svg = new DOMParser().parseFromString(await response.text(), "image/svg+xml").documentElement;
  return svg.tagName === "svg" ? document.importNode(svg, true) : null;
}

/** Makes a figure answer. `state` is that of the chart whose place it takes. */
async function awaken(figure, state) {
  if (charts.has(figure)) return;
  charts.set(figure, null);
  try {
    const svg = await drawing(figure);
    // Figures of earlier versions hold no numbers.
    if (svg === null || !figure.isConnected || svg.querySelector("metadata") === null) return;
    const chart = new Chart(figure, svg);
    if (state) chart.state = state;
    charts.set(figure, chart);
  } catch {
    // The picture stays, and the next touch tries again.
    charts.delete(figure);
  }
}

for (const kind of ["pointerover", "focusin"]) {
  document.addEventListener(kind, (event) => {
    const figure = event.target.closest?.("figure");
    if (!figure?.querySelector(".scroll > img[src*='.svg'], .scroll > svg")) return;
    // The first tap asks for values, too.
    awaken(figure).then(() => event.pointerType === "touch" && charts.get(figure)?.move(event));
  });
}

// On a narrow screen a figure is drawn as wide as the screen once it comes near.
const near = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    if (!isIntersecting) continue;
    near.unobserve(target);
    if (target.querySelector(".scroll")?.clientWidth < NARROW) awaken(target);
  }
}, { rootMargin: "400px" });

for (const figure of document.querySelectorAll("figure")) near.observe(figure);

/** A copy of a part of the page as the server sent it. */
export function asSent(part) {
  const copy = part.cloneNode(true);
  copy.querySelectorAll(".added").forEach((it) => it.remove());
  copy.querySelectorAll("figure[data-chart]").forEach((it) => delete it.dataset.chart);
  return copy;
}

/** Lets the figures of a part go on where those before them were left, of which `before` has the states. */
export function carryOn(part, before) {
  const figures = [...part.querySelectorAll("figure")];
  for (const { at, state } of before) if (figures[at]) awaken(figures[at], state);
  for (const figure of figures) near.observe(figure);
}

/** The state of each figure in a part of the page that answers. */
export function states(part) {
  return [...part.querySelectorAll("figure")].flatMap((figure, at) => {
    const chart = charts.get(figure);
    return chart ? [{ at, state: chart.state }] : [];
  });
}
