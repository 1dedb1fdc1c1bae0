// Bokeh draws; every zoom asks the server for as many points as the screen has columns.
import { columns, h, query } from "./dom.js";

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function styled(figure) {
  const [ink, line, ground] = ["--ink", "--line", "--paper"].map(colour);
  figure.background_fill_color = figure.border_fill_color = ground;
  figure.outline_line_color = line;
  for (const axis of [...figure.below, ...figure.left]) {
    if (!("axis_label_text_color" in axis)) continue;
    axis.setv({ axis_label_text_color: ink, major_label_text_color: ink, axis_line_color: line, major_tick_line_color: line, minor_tick_line_color: null, axis_label_text_font_style: "normal", axis_label_text_font_size: "12px", major_label_text_font_size: "11px" });
  }
  for (const grid of figure.center) if ("grid_line_color" in grid) grid.setv({ grid_line_color: line, grid_line_alpha: 0.6 });
  figure.toolbar.setv({ logo: null, autohide: true });
}

// On a touch screen a finger scrolls the page; it zooms after a touch on the panel's tool.
const touch = () => matchMedia("(pointer: coarse)").matches;

function panel(label, height, range, tools = "xbox_zoom,xpan,xwheel_zoom,undo,reset") {
  const figure = Bokeh.Plotting.figure({
    height, sizing_mode: "stretch_width", tools, toolbar_location: "right", output_backend: "canvas", min_border_left: 64,
    y_axis_label: label, ...(range ? { x_range: range } : {}),
  });
  if (touch()) figure.toolbar.active_drag = null;
  figure.toolbar.active_scroll = null;
  return figure;
}

// Show panels below each other in a place; returns when they stand there.
async function show(place, figures) {
  place.replaceChildren();
  const layout = new (Bokeh.Models.get ? Bokeh.Models.get("Column") : Bokeh.Models("Column"))({ children: figures, sizing_mode: "stretch_width" });
  await Bokeh.Plotting.show(layout, place);
  return layout;
}

// Ask only for the latest of many wishes: while one is under way, later ones replace each other.
function latest(work) {
  let running = false;
  let again = false;
  return async () => {
    again = true;
    if (running) return;
    running = true;
    while (again) {
      again = false;
      try {
        await work();
      } catch (error) {
        if (error.name !== "AbortError") console.warn(error.message);
      }
    }
    running = false;
  };
}

export const ORDERS = "order of a turn"; // in the place of a coordinate: how much of the torque's residual repeats with every turn

// The traces of a record: both sides of the balance, the residual, the speed; and the residual over a coordinate.
export class Traces {
  constructor(place, scatterPlace) {
    this.place = place;
    this.scatterPlace = scatterPlace;
    this.asked = null;
    this.preview = null;
    this.load = latest(() => this.fetched());
  }

  async build(record, name, unit, asked) {
    this.asked = asked;
    const first = await this.ask(record.start, record.stop);
    const { Range1d, ColumnDataSource } = Bokeh;
    const [ink, red, blue, soft] = ["--ink", "--red", "--blue", "--soft"].map(colour);
    this.record = record;
    this.source = new ColumnDataSource({ data: first.traces });
    this.shade = new ColumnDataSource({ data: { t: [record.start], preview: [NaN] } });
    this.dots = new ColumnDataSource({ data: { x: first.scatter.x, y: first.scatter.y } });
    this.means = new ColumnDataSource({ data: { centre: first.scatter.centre, mean: first.scatter.mean } });
    this.range = new Range1d({ start: record.start, end: record.stop, bounds: [record.start, record.stop] });
    const field = (one) => ({ field: one });
    const narrow = innerWidth < 700;
    const upper = panel(`${name} [${unit}]`, narrow ? 170 : 190, this.range);
    const middle = panel(`residual [${unit}]`, narrow ? 160 : 170, this.range);
    const lower = panel(record.coordinates[0], 120, this.range);
    const draw = (figure, one, color, width, more = {}) => figure.line(field("t"), field(one), { source: this.source, line_color: color, line_width: width, ...more });
    draw(upper, "measured", ink, 1.8, { legend_label: "measured" });
    draw(upper, "predicted", red, 1.1, { legend_label: "predicted" });
    upper.legend.setv({ orientation: "horizontal", location: "top_left", background_fill_alpha: 0.7, background_fill_color: colour("--paper"), label_text_color: ink, border_line_color: null, label_text_font_size: "11px", padding: 2, margin: 3 });
    draw(middle, "residual", blue, 1);
    middle.line(field("t"), field("preview"), { source: this.shade, line_color: red, line_width: 2 });
    draw(lower, "speed", soft, 1);
    lower.below[0].axis_label = "time [s]";
    for (const figure of [upper, middle, lower]) styled(figure);
    await show(this.place, [upper, middle, lower]);
    const scatter = panel(`residual [${unit}]`, narrow ? 220 : 210, null, "box_zoom,pan,undo,reset");
    this.unit = unit;
    this.cloud = scatter.scatter(field("x"), field("y"), { source: this.dots, size: 3, fill_color: blue, fill_alpha: 0.3, line_color: null });
    scatter.line(field("centre"), field("mean"), { source: this.means, line_color: red, line_width: 2.5 });
    styled(scatter);
    this.scatter = scatter;
    this.labelled();
    await show(this.scatterPlace, [scatter]);
    this.place.dataset.drawn = String(1 + Number(this.place.dataset.drawn || 0));
    this.range.change.connect(() => this.load());
  }

  get bins() {
    return Math.round(Math.max(300, this.place.clientWidth - 90));
  }

  labelled() {
    const { over } = this.asked;
    this.scatter.below[0].axis_label = over === ORDERS ? "order of a turn (dots; line: what noise reaches in one spectrum of a hundred)" : over;
    this.scatter.left[0].axis_label = `${over === ORDERS ? "amplitude" : "residual"} [${over === ORDERS ? "N m" : this.unit}]`;
    this.cloud.glyph.setv(over === ORDERS ? { size: 6, fill_alpha: 0.9 } : { size: 3, fill_alpha: 0.3 });
  }

  async update(asked) {
    this.asked = asked;
    await this.load();
  }

  async ask(start, stop) {
    const { record, balance, off, over, version } = this.asked;
    const stretch = { record, balance, off, v: version, start, stop };
    const spectrum = (orders) => {
      const x = orders[0].map((_, k) => k + 1);
      const [amplitude, level] = orders.map((row) => row.map((value) => value ?? NaN));
      return { x, y: amplitude, centre: x, mean: level };
    };
    const [traces, scatter] = await Promise.all([
      columns(`view/model?${query({ ...stretch, bins: this.bins })}`),
      over === ORDERS ? spectrum(this.asked.orders) : columns(`view/scatter?${query({ ...stretch, over })}`),
    ]);
    return { traces, scatter };
  }

  async fetched() {
    const began = performance.now();
    const { traces, scatter } = await this.ask(this.range.start, this.range.end);
    this.source.data = traces;
    this.dots.data = { x: scatter.x, y: scatter.y };
    this.means.data = { centre: scatter.centre, mean: scatter.mean };
    this.labelled();
    await this.shaded();
    this.place.dataset.milliseconds = (performance.now() - began).toFixed(1);
    this.place.dataset.drawn = String(1 + Number(this.place.dataset.drawn || 0));
  }

  // Lay what a candidate would take away over the residual; null takes the curve away.
  async hover(effect) {
    this.preview = effect;
    clearTimeout(this.waiting); // a pointer that only passes asks for nothing
    this.waiting = setTimeout(() => this.shaded().catch(() => {}), effect ? 80 : 0);
  }

  async shaded() {
    const effect = this.preview;
    if (!effect || this.asked.record !== 0) {
      if (this.shade.data.t.length > 1) this.shade.data = { t: [this.record.start], preview: [NaN] };
      return;
    }
    const { balance, version } = this.asked;
    const found = await columns(`view/preview?${query({ effect, balance, v: version, start: this.range.start, stop: this.range.end, bins: this.bins })}`);
    if (this.preview === effect) this.shade.data = { t: found.t, preview: found.preview };
  }

  zoom(start, stop) {
    this.range.setv({ start, end: stop });
  }
}

// One channel of a log, to be zoomed; built when its place is opened.
export function drawChannel(place, entry) {
  const details = place.closest("details");
  const names = entry.info.channels.map((one) => one.channel).filter((name) => name !== "t");
  const build = async () => {
    if (place.dataset.built) return;
    place.dataset.built = "yes";
    const choice = h("select", { "aria-label": `Channel of ${entry.name}` }, names.map((name) => h("option", {}, name)));
    const drawing = h("div", { class: "plot" });
    place.replaceChildren(choice, drawing);
    const range = new Bokeh.Range1d({ start: entry.info.start, end: entry.info.stop, bounds: [entry.info.start, entry.info.stop] });
    const ask = (start, stop) => columns(`view/log?${query({ log: entry.id, channels: choice.value, start, stop, bins: Math.max(300, drawing.clientWidth - 90) })}`);
    const first = await ask(entry.info.start, entry.info.stop);
    const source = new Bokeh.ColumnDataSource({ data: { t: first.t, y: first[choice.value] } });
    const label = () => `${choice.value} [${entry.info.channels.find((one) => one.channel === choice.value).unit}]`;
    const figure = panel(label(), 200, range);
    figure.line({ field: "t" }, { field: "y" }, { source, line_color: colour("--blue"), line_width: 1 });
    figure.below[0].axis_label = "time [s]";
    styled(figure);
    const load = latest(async () => {
      const name = choice.value;
      const began = performance.now();
      const found = await ask(range.start, range.end);
      if (name !== choice.value) return;
      source.data = { t: found.t, y: found[name] };
      figure.left[0].axis_label = label();
      drawing.dataset.milliseconds = (performance.now() - began).toFixed(1);
    });
    await show(drawing, [figure]);
    range.change.connect(() => load());
    choice.addEventListener("change", () => load());
  };
  if (details.open) build();
  else details.addEventListener("toggle", build, { once: true });
}

// Estimates over time with their bands of 95 %, the value of the design, and the abrupt changes.
export class Bands {
  constructor(place, names, units) {
    const { Range1d, ColumnDataSource } = Bokeh;
    const [red, blue, ink] = ["--red", "--blue", "--ink"].map(colour);
    const field = (one) => ({ field: one });
    this.place = place;
    this.names = names;
    this.range = new Range1d({ start: 0, end: 1 });
    this.source = new ColumnDataSource({ data: {} });
    this.stated = new ColumnDataSource({ data: { t: [] } });
    this.alarms = new ColumnDataSource({ data: { t: [] } });
    this.empty = Object.fromEntries(["t", ...names.flatMap((name) => [name, `${name}-low`, `${name}-high`])].map((name) => [name, []]));
    this.source.data = this.empty;
    const figures = names.map((name) => {
      const figure = panel(`${name} [${units[name]}]`, 200, this.range, "save");
      figure.varea(field("t"), field(`${name}-low`), field(`${name}-high`), { source: this.source, fill_color: blue, fill_alpha: 0.25 });
      figure.line(field("t"), field(name), { source: this.source, line_color: blue, line_width: 1.6 });
      figure.line(field("t"), field(name), { source: this.stated, line_color: ink, line_width: 1, line_dash: [2, 4] });
      figure.vspan(field("t"), { source: this.alarms, line_color: red, line_width: 1.5 });
      styled(figure);
      return figure;
    });
    figures.at(-1).below[0].axis_label = "time [s]";
    show(place, figures);
  }

  update(found) {
    const data = { t: found.t };
    for (const name of this.names) {
      const half = found[`stderr_${name}`].map((one) => 1.96 * one);
      data[name] = found[name];
      data[`${name}-low`] = found[name].map((one, k) => one - half[k]);
      data[`${name}-high`] = found[name].map((one, k) => one + half[k]);
    }
    const [start, end] = [found.t[0], Math.max(found.t.at(-1), found.t[0] + 1)];
    this.source.data = data;
    this.stated.data = { t: [start, end], ...Object.fromEntries(this.names.map((name) => [name, Array(2).fill(found.stated[name] ?? NaN)])) };
    this.alarms.data = { t: found.alarms.map((one) => one.t).filter((t) => t >= start) };
    this.range.setv({ start, end });
    this.place.dataset.drawn = String(1 + Number(this.place.dataset.drawn || 0));
  }
}
