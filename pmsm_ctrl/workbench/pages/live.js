// Live: F_c and F_v of the source that the server was started with, while the axis runs.
import { fill, get, h, number } from "./dom.js";
import { Bands } from "./plots.js";

const POLL = 1000; // ms
const SILENT = 5; // s without a sample after which that is said
const NAMES = ["F_c", "F_v"];

let found = null;
let bands = null;
let waiting = 0;

export function showLive(section, app) {
  if (!section.querySelector(".plot")) {
    section.replaceChildren(
      h("h2", {}, "Friction while the axis runs"),
      h("div", { "data-part": "now" }),
      h("div", { class: "plot", "data-part": "bands", role: "group", "aria-label": "F_c and F_v over time, with bands of 95 %" }),
      h("div", { "data-part": "alarms" }));
  }
  draw(section, app);
  if (!waiting) ask(section, app);
}

async function ask(section, app) {
  clearTimeout(waiting);
  waiting = setTimeout(() => ask(section, app), POLL);
  if (document.hidden || section.hidden) return;
  try {
    found = await get("live");
  } catch (error) {
    app.complaint = error.message;
    app.refresh();
    return;
  }
  draw(section, app);
}

const value = (name) => `${number(found.now[name], 4)} ± ${number(1.96 * found.now[`stderr_${name}`], 2)} ${found.units[name]}`;

function draw(section) {
  if (!found) return;
  const place = (name) => section.querySelector(`[data-part=${name}]`);
  const silent = !found.end && found.silent > SILENT ? Math.floor(found.silent) : 0;
  fill(place("now"), [found.revision, silent], () => [
    h("p", { class: "soft" }, `Source ${found.source}, design ${found.design}. An extended Kalman filter; ± and the bands are 95 %, and narrow where the motion tells F_c from F_v. Dotted: the design; orange: changes between windows of 10 s of motion.`),
    found.end ? h("p", { class: "complaint", role: "alert", id: "live-end" }, found.end) : null,
    silent ? h("p", { class: "complaint", role: "status" }, `No sample for ${silent} s.`) : null,
    found.now
      ? h("dl", { class: "readings" }, NAMES.map((name) => h("div", {}, h("dt", {}, name), h("dd", { id: `live-${name}` }, value(name)), h("dd", { class: "soft" }, `design: ${found.stated[name] === null ? "none" : `${number(found.stated[name])} ${found.units[name]}`}`))),
        h("div", {}, h("dt", {}, "time"), h("dd", { id: "live-t" }, `${found.now.t.toFixed(1)} s`), h("dd", { class: "soft" }, `last sample: ${found.now.event}`)))
      : found.end ? null : h("p", {}, "Waiting for samples …"),
  ]);
  fill(place("alarms"), found.alarms, () => [
    h("h3", {}, "Changes of friction"),
    found.alarms.length
      ? h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Changes of friction" }, h("table", { id: "live-alarms" },
        h("thead", {}, h("tr", {}, ["parameter", "change", "time [s]", "between [s]", "before", "after"].map((text) => h("th", { scope: "col" }, text)))),
        h("tbody", {}, found.alarms.slice(-20).reverse().map((one) => h("tr", {}, [`${one.parameter} [${found.units[one.parameter]}]`, one.kind, one.t.toFixed(1), `${one.earliest.toFixed(1)} to ${one.latest.toFixed(1)}`, number(one.before), number(one.after)].map((text) => h("td", {}, text)))))))
      : h("p", { class: "soft" }, "None so far."),
  ]);
  if (!found.t.length) return;
  if (!bands) bands = new Bands(place("bands"), NAMES, found.units);
  bands.update(found);
}
