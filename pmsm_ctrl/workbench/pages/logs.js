// Step 2: the logs, what was understood of them, and what is doubtful.
import { fill, h, number, size } from "./dom.js";
import { dropping, files } from "./design.js";
import { drawChannel } from "./plots.js";

const ROLES = [["fit", "Fit"], ["holdout", "Held out"], ["off", "Leave out"]];
const editing = new Set(); // logs whose channels are being corrected

export function showLogs(section, app) {
  const { state } = app;
  fill(section, [state.logs, [...editing], app.uploading], () => [
    h("h2", {}, "Logs of this axis"),
    h("p", { class: "lead" }, "Any motion that reverses and changes speed. Parameters and effects are fitted to the logs marked Fit; a log marked Held out is only predicted, and shows whether an effect is real."),
    h("p", { class: "soft", id: "roles-note" }, "The first log is taken as Fit, the second as Held out, any further one as Fit; change it at each log."),
    drop(app),
    state.logs.map((entry) => card(app, entry)),
    state.logs.length ? blocked(state) : null,
    state.logs.length ? h("p", {}, h("button", { type: "button", class: "main", id: "to-compare", disabled: !usable(state), onclick: () => app.enter("compare") }, "Next: compare")) : null,
  ]);
  for (const place of section.querySelectorAll("[data-closer]")) drawChannel(place, state.logs.find((one) => one.id === place.dataset.closer));
}

// What has to be settled before the logs can be compared, in words.
export function blockers(state) {
  const out = state.logs.some((one) => one.role === "fit") ? [] : ["No log is marked Fit."];
  for (const { name, role, info } of state.logs) {
    if (role === "off") continue;
    if (!info) out.push(`${name} is still being read.`);
    else if (info.error) out.push(`${name} could not be read: name its channels, or leave it out.`);
    else for (const doubt of info.doubts) if (doubt.channel) out.push(`${name}: the unit of ${doubt.channel} is in doubt; confirm or correct it.`);
  }
  return out;
}

export const usable = (state) => !blockers(state).length;

export const blocked = (state) => (usable(state) ? null : h("ul", { class: "doubts" }, blockers(state).map((text) => h("li", {}, text))));

function drop(app) {
  const take = async (files) => {
    for (const file of files) if (await app.upload(file)) break;
  };
  return h("div", { class: "card drop big", ...dropping(take) },
    h("p", { class: "row" }, h("b", {}, `Drop ${app.state.logs.length ? "more " : ""}log files here, or`), files("log-file", "Choose log files", { multiple: true }, take)),
    h("p", { class: "soft" }, "CSV and other text, MAT, MDF4, TDMS, Parquet, NumPy, ROS 2 bags. Needed: time, position or speed, and current or torque. Files stay on this computer."));
}

function card(app, entry) {
  const { info } = entry;
  const facts = info && !info.error ? `${info.samples.toLocaleString("en")} samples, ${number(info.stop - info.start)} s at ${number(info.rate)} Hz, ${info.format}` : size(entry.bytes);
  return h("article", { class: `card log ${entry.role}`, "aria-label": `Log ${entry.name}` },
    h("div", { class: "head" },
      h("h3", {}, entry.name), h("span", { class: "soft" }, facts), roles(app, entry),
      h("button", { type: "button", class: "plain", "aria-label": `Remove ${entry.name}`, onclick: () => app.act(`logs/${entry.id}`, {}, "DELETE") }, "Remove")),
    !info ? h("p", { class: "soft" }, "Waiting to be read …") : info.error ? h("p", { class: "complaint", role: "alert" }, info.error) : null,
    info && !info.error ? [doubts(app, entry), span(app, entry)] : null,
    info && (info.error ? info.columns.length : editing.has(entry.id)) ? editor(app, entry) : info && !info.error ? tiles(app, entry) : null,
    info && !info.error ? h("details", { id: `closer-${entry.id}` }, h("summary", {}, "Zoom into the channels, notes of the import"), h("div", { "data-closer": entry.id }),
      h("ul", { class: "soft" }, info.notes.map((text) => h("li", {}, text)))) : null);
}

function roles(app, entry) {
  return h("fieldset", { class: "roles" }, h("legend", { class: "hidden" }, `Use of ${entry.name}`),
    ROLES.map(([role, words]) => h("label", {}, h("input", { type: "radio", name: `role-${entry.id}`, id: `role-${entry.id}-${role}`, checked: entry.role === role, onchange: () => app.act(`logs/${entry.id}`, { role }) }), words)));
}

function doubts(app, entry) {
  const { info } = entry;
  if (!info.doubts.length) return h("p", { class: "good" }, "✓ Plausibility checks: no warning.");
  return h("ul", { class: "doubts" }, info.doubts.map((doubt) => h("li", {}, doubt.text, doubt.channel ? h("span", { class: "row" },
    h("button", { type: "button", id: `confirm-${entry.id}-${doubt.channel}`, onclick: () => confirm(app, entry, doubt.channel) }, `The unit of ${doubt.channel} is right`),
    h("button", { type: "button", onclick: () => edit(app, entry) }, "Correct it")) : null)));
}

function confirm(app, entry, channel) {
  const one = entry.info.channels.find((other) => other.channel === channel);
  return app.act(`logs/${entry.id}`, { mapping: { ...entry.mapping, [channel]: `#${one.number} [${one.stated}]` } });
}

function edit(app, entry) {
  if (editing.has(entry.id)) editing.delete(entry.id);
  else editing.add(entry.id);
  showLogs(document.getElementById("logs"), app);
}

const curve = (values) => values.map((value, k) => `${k ? "L" : "M"}${((100 * k) / Math.max(values.length - 1, 1)).toFixed(2)} ${(27 - 24 * value).toFixed(2)}`).join("");

const picture = (values) => h("svg", { viewBox: "0 0 100 30", preserveAspectRatio: "none", "aria-hidden": "true" }, h("path", { d: curve(values) }));

function tiles(app, entry) {
  const { info } = entry;
  const shown = info.channels.filter((one) => one.channel !== "t");
  return [
    h("div", { class: "tiles" }, shown.map((one) => h("div", { class: "tile" },
      h("b", {}, one.channel), h("span", { class: "unit" }, ` ${one.unit}`),
      picture(one.picture),
      h("span", { class: "soft" }, `${number(one.low, 3)} … ${number(one.high, 3)}`),
      one.how === "guessed" || one.assumed || Math.abs(one.gain - 1) > 1e-12 ? h("span", { class: "soft" }, `${one.how} from “${one.label}”${one.assumed ? ", unit assumed" : one.stated !== one.unit ? ` [${one.stated}]` : ""}`) : null))),
    h("p", { class: "soft row" }, info.unused.length ? `Not used: ${info.unused.slice(0, 8).join(", ")}${info.unused.length > 8 ? ", …" : ""}. ` : "",
      h("button", { type: "button", id: `edit-${entry.id}`, onclick: () => edit(app, entry) }, "Correct channels and units")),
  ];
}

function editor(app, entry) {
  const { info } = entry;
  const have = Object.fromEntries((info.channels || []).map((one) => [one.channel, one]));
  const rows = app.about.channels.map((channel) => {
    const one = have[channel.name];
    const stated = /^(?:(-)|([-\d.e]+) \* )?#(\d+)(?: \[(.*)\])?$/.exec(entry.mapping[channel.name] || "");
    const column = stated ? +stated[3] : one?.number > 0 ? one.number : 0;
    const unit = stated?.[4] || one?.stated || channel.units[0];
    const factor = stated ? (stated[1] ? "-1" : stated[2] || "1") : "1";
    const id = `${entry.id}-${channel.name}`;
    return h("tr", {},
      h("th", { scope: "row" }, h("label", { for: `c-${id}` }, channel.name), h("span", { class: "soft" }, ` ${channel.meaning}`)),
      h("td", {}, h("select", { id: `c-${id}` }, h("option", { value: "0" }, "–"), info.columns.map((other, k) => h("option", { value: k + 1, selected: column === k + 1 }, `${k + 1}: ${other.label}${other.unit && !other.label.includes(other.unit) ? ` [${other.unit}]` : ""}`)))),
      h("td", {}, h("select", { id: `u-${id}`, "aria-label": `Unit of ${channel.name}` }, [...new Set([unit, ...channel.units])].map((other) => h("option", { value: other, selected: other === unit }, other)))),
      h("td", {}, h("input", { id: `f-${id}`, class: "short", inputmode: "decimal", value: factor, "aria-label": `Factor of ${channel.name}` })));
  });
  const apply = () => {
    const mapping = {};
    for (const { name } of app.about.channels) {
      const id = `${entry.id}-${name}`;
      const column = +document.getElementById(`c-${id}`).value;
      if (!column) continue;
      const factor = document.getElementById(`f-${id}`).value.trim() || "1";
      const before = +factor === 1 ? "" : +factor === -1 ? "-" : `${factor} * `;
      mapping[name] = `${before}#${column} [${document.getElementById(`u-${id}`).value}]`;
    }
    editing.delete(entry.id);
    app.act(`logs/${entry.id}`, { mapping });
  };
  const period = h("input", { id: `p-${entry.id}`, class: "short", inputmode: "decimal", "aria-label": "Sampling period in ms" });
  const everyPeriod = () => app.act(`logs/${entry.id}`, { mapping: { ...entry.mapping, t: `every ${period.value.trim()} ms` } });
  return h("div", { class: "editor" },
    h("p", { class: "soft" }, "Choose the column and the unit of each channel that the file has. Needed: t; theta or omega; i_q or torque. A sign is turned with the factor -1."),
    h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": `Channels of ${entry.name}` },
      h("table", {}, h("thead", {}, h("tr", {}, ["channel", "column of the file", "its unit", "times"].map((text) => h("th", { scope: "col" }, text)))), h("tbody", {}, rows))),
    h("p", { class: "row" }, h("button", { type: "button", class: "main", id: `apply-${entry.id}`, onclick: apply }, "Apply"),
      info.error ? null : h("button", { type: "button", onclick: () => edit(app, entry) }, "Cancel")),
    info.columns.length ? h("p", { class: "row soft" }, "No column holds the time? One sample every ", period, " ms ", h("button", { type: "button", onclick: everyPeriod }, "Use this period")) : null);
}

// The stretch of time that is used: dragged over the picture of the motion, or typed.
function span(app, entry) {
  const { info } = entry;
  const main = info.channels.find((one) => one.channel === "omega") || info.channels.find((one) => one.channel === "theta");
  const [from, to] = entry.window || [info.start, info.stop];
  const share = (t) => (100 * (t - info.start)) / (info.stop - info.start || 1);
  const chosen = h("rect", { class: "chosen", y: "0", height: "30", x: share(from), width: share(to) - share(from) });
  const drawing = h("svg", { viewBox: "0 0 100 30", preserveAspectRatio: "none", class: "span", "aria-hidden": "true" }, chosen, h("path", { d: curve(main?.picture || []) }));
  let begin = null;
  const place = (event) => {
    const box = drawing.getBoundingClientRect();
    return Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
  };
  drawing.addEventListener("pointerdown", (event) => {
    begin = place(event);
    drawing.setPointerCapture(event.pointerId);
  });
  drawing.addEventListener("pointermove", (event) => {
    if (begin === null) return;
    const now = place(event);
    chosen.setAttribute("x", 100 * Math.min(begin, now));
    chosen.setAttribute("width", 100 * Math.abs(now - begin));
  });
  drawing.addEventListener("pointerup", (event) => {
    const now = place(event);
    const [a, b] = [Math.min(begin, now), Math.max(begin, now)].map((one) => info.start + one * (info.stop - info.start));
    begin = null;
    use(b - a > 0.01 * (info.stop - info.start) ? [a, b] : null);
  });
  const use = (window) => app.act(`logs/${entry.id}`, { window });
  const typed = () => {
    const [a, b] = ["from", "to"].map((end) => Number(document.getElementById(`${end}-${entry.id}`).value));
    use(a <= info.start && b >= info.stop ? null : [a, b]);
  };
  return h("div", { class: "window" }, drawing,
    h("p", { class: "row soft" }, "Use from ", h("input", { id: `from-${entry.id}`, class: "short", type: "number", step: "any", value: number(from, 6), onchange: typed, "aria-label": `Begin of the window of ${entry.name}, s` }),
      " to ", h("input", { id: `to-${entry.id}`, class: "short", type: "number", step: "any", value: number(to, 6), onchange: typed, "aria-label": `End of the window of ${entry.name}, s` }), " s",
      entry.window ? h("button", { type: "button", onclick: () => use(null) }, "Whole record") : h("span", {}, " (drag over the picture to choose)")));
}
