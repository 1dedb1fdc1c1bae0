// Step 3: the traces, the residual, the candidates, and the error of the model after every effect.
import { fill, h, number, percent } from "./dom.js";
import { blocked, usable } from "./logs.js";
import { ORDERS, Traces } from "./plots.js";

const view = { record: 0, balance: "torque", over: "", off: new Set(), drawn: "", traces: null, version: 0, code: null };

export function showCompare(section, app) {
  const { model, job } = app.state;
  if (!section.querySelector(".bench")) section.replaceChildren(frame(app));
  const place = (name) => section.querySelector(`[data-part=${name}]`);
  section.querySelector(".bench").hidden = !model;
  fill(place("begin"), [!!model, !!job, app.state.message, app.state.logs], () => (model ? [] : [
    h("h2", {}, "Compare the design with the logs"),
    app.state.message && !job ? h("p", { class: "complaint" }, app.state.message) : null,
    job ? h("p", {}, "The base parameters are being fitted …") : h("div", {}, blocked(app.state), h("button", { type: "button", class: "main", id: "begin", disabled: !usable(app.state), onclick: () => app.act("steps", { begin: true }) }, "Compare")),
  ]));
  if (!model) return;
  if (view.record >= model.records.length) view.record = 0;
  const record = model.records[view.record];
  if (!record.balances.some((one) => one.name === view.balance)) view.balance = record.balances[0].name;
  if (!drawable(record).includes(view.over)) view.over = record.coordinates[0];
  for (const name of view.off) if (!model.names.includes(name)) view.off.delete(name);
  const busy = !!job;
  fill(place("models"), [model.models, model.names, model.verdict, busy, job?.kind, [...view.off], view.record, view.balance, job?.models?.length], () => errorsByModel(app, record));
  fill(place("candidates"), [model.candidates, busy, app.state.own], () => candidates(app));
  fill(place("choices"), [model.records.map((one) => one.name), view.record, view.balance, view.over], () => choices(app, model, record));
  draw(record, app);
}

function frame(app) {
  addEventListener("scheme", () => (view.drawn = ""));
  return h("div", {},
    h("div", { "data-part": "begin" }),
    h("div", { class: "bench", hidden: true },
      h("div", { class: "left" }, h("div", { "data-part": "choices", class: "row choices" }), h("div", { class: "plot", "data-part": "traces", role: "group", "aria-label": "Traces over time: measured and predicted, residual, speed" }),
        h("div", { class: "plot", "data-part": "scatter", role: "group", "aria-label": "Residual over a coordinate, with its mean" })),
      h("div", { class: "right" }, h("div", { "data-part": "models" }), h("div", { "data-part": "candidates" }))));
}

async function draw(record, app) {
  const section = document.getElementById("compare");
  const place = section.querySelector("[data-part=traces]");
  const balance = record.balances.find((one) => one.name === view.balance);
  const kind = app.state.design.motion === "linear" && balance.name === "torque" ? "force" : balance.name;
  const wanted = JSON.stringify([record.curves, [...view.off], view.balance, view.over]);
  const frameKey = JSON.stringify([record.name, record.held_out, record.start, record.stop, view.balance, innerWidth < 700, matchMedia("(prefers-color-scheme: dark)").matches]);
  if (view.drawn === wanted + frameKey) return;
  const fresh = view.frame !== frameKey || !view.traces || view.drawn === "";
  view.drawn = wanted + frameKey;
  view.frame = frameKey;
  const asked = { record: view.record, balance: view.balance, off: [...view.off].join("|"), over: view.over, orders: record.orders, version: record.curves };
  if (!fresh) return view.traces.update(asked);
  view.traces = new Traces(place, section.querySelector("[data-part=scatter]"));
  await view.traces.build(record, kind, balance.unit, asked).catch((error) => {
    view.drawn = "";
    app.complaint = error.message;
  });
}

function choose(app, key) {
  return (event) => {
    view[key] = key === "record" ? Number(event.target.value) : event.target.value;
    showCompare(document.getElementById("compare"), app);
  };
}

function choices(app, model, record) {
  const select = (id, words, values, chosen, key) => h("label", {}, words, " ", h("select", { id, onchange: choose(app, key) }, values.map(([value, text]) => h("option", { value, selected: String(value) === String(chosen) }, text))));
  const torque = app.state.design.motion === "linear" ? "force" : "torque";
  return [
    model.records.length > 1 ? select("record", "Record", model.records.map((one, k) => [k, `${one.name} (${one.held_out ? "held out" : "fitted"})`]), view.record, "record") : h("span", {}, `Record ${record.name}`),
    record.balances.length > 1 ? select("balance", "Balance", record.balances.map((one) => [one.name, one.name === "torque" ? torque : one.name]), view.balance, "balance") : null,
    select("over", "Residual over", drawable(record).map((one) => [one, one]), view.over, "over"),
    h("button", { type: "button", id: "whole", onclick: () => view.traces?.zoom(record.start, record.stop) }, "Whole record"),
    h("span", { class: "zoom" }, ["In", "Out", "←", "→"].map((word) => h("button", { type: "button", "aria-label": { In: "Zoom in", Out: "Zoom out", "←": "Earlier", "→": "Later" }[word], onclick: () => step(word, record) }, word))),
  ];
}

// What the residual is drawn over: the coordinates, and the orders of a turn where there are turns.
const drawable = (record) => [...record.coordinates, ...(record.orders ? [ORDERS] : [])];

function step(word, record) {
  const { start, end } = view.traces.range;
  const middle = 0.5 * (start + end);
  const half = (end - start) * { In: 0.25, Out: 1, "←": 0.5, "→": 0.5 }[word];
  const shift = (end - start) * { In: 0, Out: 0, "←": -0.5, "→": 0.5 }[word];
  const width = Math.min(2 * half, record.stop - record.start);
  const from = Math.min(Math.max(record.start, middle + shift - 0.5 * width), record.stop - width);
  view.traces.zoom(from, from + width);
}

// -- the error of every model ------------------------------------------------------------------------------------

const error = (errors, balance) => errors[balance]?.relative ?? errors.torque?.relative ?? NaN;

// The logs of a role, in words.
function called(app, role) {
  const names = app.state.logs.filter((one) => one.role === role).map((one) => one.name);
  return names.length > 1 ? `${names.length} logs` : names.join("");
}

function errorsByModel(app, record) {
  const { model, job } = app.state;
  const balance = view.balance;
  const held = model.models.some((one) => Object.keys(one.holdout).length);
  const floor = model.floor?.[balance] ?? Infinity;
  const off = model.names.filter((name) => view.off.has(name));
  const [own, others] = [false, true].map((which) => without(model.records.filter((one) => one.held_out === which), balance, off));
  const most = Math.max(...(off.length ? [own, others || 0] : []), ...model.models.map((one) => Math.max(error(one.errors, balance), held ? error(one.holdout, balance) || 0 : 0)));
  const bar = (kind, share) => h("span", { class: `meter ${kind}` }, h("span", { class: "track" }, h("i", { style: { width: `${Math.min(100, (100 * share) / most)}%` } }), floor < most ? h("u", { style: { left: `${(100 * floor) / most}%` } }) : null), h("em", {}, percent(share)));
  const searching = job?.kind === "find";
  const shown = searching ? [model.models[0], ...(job.models || [])] : model.models;
  const apart = off.length && !searching ? h("li", { class: "apart", id: "without" }, h("span", { class: "name" }, `Without ${off.map((name) => titled(model, name)).join(", ")}`, h("small", {}, "all other parameters held")), bar("fitted", own), held && others ? bar("held", others) : null) : null;
  const models = shown.map((one) => h("li", { class: searching ? "live" : null }, h("span", { class: "name" }, words(model, one.name)), bar("fitted", error(one.errors, balance)), held ? bar("held", error(one.holdout, balance)) : null));
  const busy = !!job;
  const last = shown.at(-1);
  const said = (fitted, other) => `error ${percent(fitted)} on the fitted ${called(app, "fit")}${other ? `, ${percent(other)} on the held-out ${called(app, "holdout")}` : ""}`;
  const left = !model.verdict && model.candidates.some((one) => one.advised); // else the next thing is to take the design away
  return [
    h("h2", {}, "Error of each model"),
    h("p", { class: "soft legend", id: "models-note" }, h("span", { class: "key fitted" }), `fitted: ${called(app, "fit")}`, held ? [h("span", { class: "key held" }), `held out: ${called(app, "holdout")}`] : " (no held-out log)", floor < most ? [h("span", { class: "key floor" }), `noise floor of the fitted ${model.records.filter((one) => !one.held_out).length > 1 ? "logs" : "log"} ${percent(floor)}`] : null, `. Rms of measured − predicted, relative to measured: ${balance}${model.cutoff ? `, all records low-passed at ${number(model.cutoff, 3)} Hz, which the fitted log allows` : ""}.`),
    model.verdict && !searching ? h("p", { class: "verdict", id: "verdict" }, model.verdict.text, model.verdict.reasons.map((text) => `: ${text}`), ".") : null,
    h("ol", { class: "models", id: "models" }, models, apart),
    h("p", { class: "row" },
      h("button", { type: "button", id: "find", class: left ? "main" : "", disabled: busy, "aria-describedby": "find-note", onclick: () => app.act("steps", { find: true }) }, "Find all"),
      h("button", { type: "button", id: "undo", disabled: busy || !app.state.steps.length, onclick: () => app.act("steps", { undo: true }) }, "Undo"),
      h("button", { type: "button", class: left ? "" : "main", disabled: busy, onclick: () => app.go("take"), id: "to-take" }, "Take away")),
    h("p", { class: "soft", id: "find-note" }, "Find all: the whole diagnosis from the base parameters on, one effect after the other, each tested."),
    model.names.length ? switches(app, record, busy) : null,
    h("p", { class: "hidden", role: "status" }, apart ? `Without ${off.map((name) => titled(model, name)).join(", ")}: ${said(own, held && others)}` : `${[words(model, last.name)].flat()[0]}: ${said(error(last.errors, balance), held && error(last.holdout, balance))}`),
  ];
}

// An effect that was added, in words: its title, and the order where it has one.
export function titled(model, name) {
  const [id, order] = name.split(" ");
  return `${model.titles?.[id] || id}${order ? ` (order ${order})` : ""}`;
}

// A model in words: what was added, and its id.
function words(model, name) {
  const [, sign, id, order] = /^([+-]) (\S+) ?(.*)$/.exec(name) || [];
  const title = model.titles?.[id];
  return title ? [`${sign === "-" ? "−" : "+"} ${title}`, h("small", {}, `${id} ${order}`)] : name[0].toUpperCase() + name.slice(1);
}

function switches(app, record, busy) {
  const { names } = app.state.model;
  const balance = record.balances.find((one) => one.name === view.balance);
  const flip = (name) => (event) => {
    if (event.target.checked) view.off.delete(name);
    else view.off.add(name);
    showCompare(document.getElementById("compare"), app);
  };
  const moved = (k, by) => {
    const order = [...names];
    [order[k], order[k + by]] = [order[k + by], order[k]];
    app.act("steps", { order });
  };
  return h("div", { class: "added" },
    h("h3", {}, "Added effects"),
    h("ul", { class: "plain" }, names.map((name, k) => h("li", { class: "row" },
      h("label", {}, h("input", { type: "checkbox", id: `switch-${k}`, checked: !view.off.has(name), disabled: !balance.parts.includes(name), onchange: flip(name) }), " ", h("span", {}, titled(app.state.model, name))),
      k > 0 ? h("button", { type: "button", class: "plain", disabled: busy, "aria-label": `Add ${titled(app.state.model, name)} earlier`, title: "Add earlier", onclick: () => moved(k, -1) }, "↑") : null,
      h("button", { type: "button", class: "plain", disabled: busy, id: `remove-${k}`, "aria-label": `Remove ${titled(app.state.model, name)}`, title: "Remove", onclick: () => app.act("steps", { remove: name }) }, "×"),
      parameters(app, name), alike(app.state.model, k)))),
    h("p", { class: "soft" }, "Switch one off to see in the traces, fitted or held out, what it explains; the error without it stands below the models."));
}

// The error of some records together without some effects; the residual is then the residual with all plus those parts.
function without(records, name, off) {
  let [left, whole] = [0, 0];
  for (const balance of records.map((one) => one.balances.find((each) => each.name === name)).filter(Boolean)) {
    const rows = [0, ...off.map((part) => balance.parts.indexOf(part) + 1).filter((n) => n > 0)];
    for (const a of rows) for (const b of rows) left += (balance.count ?? 1) * balance.products[a][b];
    whole += (balance.count ?? 1) * balance.size ** 2;
  }
  return whole ? Math.sqrt(Math.max(left, 0) / whole) : NaN;
}

function parameters(app, name) {
  const id = name.split(" ")[0];
  const entries = app.state.model.effects.filter((one) => one.id === id && !one.given);
  const same = app.state.model.names.filter((one) => one.split(" ")[0] === id);
  const entry = entries[same.indexOf(name)];
  return entry ? explained(entry, "soft") : null;
}

// The parameters of an effect, each with what it means.
export function explained(entry, look = "") {
  return h("ul", { class: `plain meanings ${look}` }, entry.parameters.map((text, k) => h("li", {}, text, entry.meanings?.[k] ? h("span", { class: "soft" }, `, ${entry.meanings[k]}`) : null)));
}

// What a search says of the look-alikes of an effect that it found.
function alike(model, k) {
  const found = model.alike?.[k];
  const named = (ids) => ids.map((id) => model.titles?.[id] || id).join(", ");
  return found ? [
    found.same.length ? h("span", { class: "soft same" }, `This log cannot tell it from: ${named(found.same)}.`) : null,
    found.apart.length ? h("span", { class: "soft apart" }, `Told apart on this log from: ${named(found.apart)}.`) : null,
  ] : null;
}

// -- the candidates --------------------------------------------------------------------------------------------

const SHARE = "Share of the mean square of the residual: low-passed, all balances, weighted as in the fit, before everything is fitted again. The errors of the models are rms: half the rms is a quarter of the mean square.";

function candidates(app) {
  const { model, job } = app.state;
  const busy = !!job;
  const advised = model.candidates.filter((one) => one.advised);
  const others = model.candidates.filter((one) => !one.advised && one.possible);
  const closed = model.candidates.filter((one) => !one.possible);
  const row = (one, k, group) => {
    const look = (on) => () => view.traces?.hover(on && !app.state.job ? one.name : null);
    return h("tr", { tabindex: "0", id: `candidate-${group}-${k}`, "data-effect": one.name, onmouseenter: look(true), onmouseleave: look(false), onfocusin: look(true), onfocusout: look(false) },
      h("td", {}, h("b", {}, one.title), h("span", { class: "soft" }, one.name), detail(one, model.titles)),
      h("td", { class: "share" }, h("span", { class: "meter thin" }, h("i", { style: { width: `${100 * one.explained}%` } })), h("em", {}, one.explained >= 0.0005 ? percent(one.explained) : "< 0.05 %")),
      h("td", {}, h("button", { type: "button", id: `add-${group}-${k}`, disabled: busy, class: one.advised ? "main" : "", "aria-label": `Add ${one.title} (${one.name})`, onclick: () => add(app, one) }, "Add")));
  };
  const table = (list, group) => h("table", { class: "candidates" },
    h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "effect"), h("th", { scope: "col", title: SHARE }, "share of the residual that it explains"), h("th", { scope: "col" }, h("span", { class: "hidden" }, "add")))),
    h("tbody", {}, list.map((one, k) => row(one, k, group))));
  return [
    h("h2", {}, "What is missing?"),
    advised.length
      ? [h("p", { class: "soft" }, "Significant on this log. Move over one, or reach it with the Tab key: the orange curve over the residual is what it would take away."), h("p", { class: "soft", id: "share-note" }, SHARE), table(advised, "a")]
      : h("p", {}, "No candidate passes the tests: nothing of the catalogue is missing, as far as these logs show."),
    h("details", { id: "refused" }, h("summary", {}, `${others.length} candidates that the log does not call for`), table(others, "b")),
    app.about.template ? ownEffect(app) : null,
    closed.length ? h("details", { id: "closed" }, h("summary", {}, `${closed.length} that this log cannot evaluate: ${closed.map((one) => one.title).join(", ")}`), h("ul", {}, closed.map((one) => h("li", {}, h("b", {}, one.title), `: ${one.why_not}`)))) : null,
  ];
}

// Where the server was started for it: an effect that is written here.
function ownEffect(app) {
  const { own, code } = app.state;
  const use = async (text) => {
    const failed = await app.act("effects", { code: text });
    if (failed) return;
    view.code = null;
    app.enter("compare");
  };
  return h("details", { id: "own" }, h("summary", {}, "An effect of your own"),
    own?.length ? h("p", {}, "Offered: ", own.map((one) => `${one.title} (${one.id})`).join(", "), " ", h("button", { type: "button", class: "plain", disabled: !!app.state.job, onclick: () => use("") }, "Take back")) : null,
    h("label", { for: "own-code" }, "Python code, which is run on the computer of the server; the model begins anew with what it offers."),
    h("textarea", { id: "own-code", rows: "14", spellcheck: "false", autocomplete: "off", value: view.code ?? (code || app.about.template), oninput: (event) => (view.code = event.target.value) }),
    h("button", { type: "button", id: "own-use", disabled: !!app.state.job, onclick: () => use(document.getElementById("own-code").value) }, "Run it, and offer the effect"));
}

async function add(app, one) {
  view.traces?.hover(null);
  const failed = await app.act("steps", { add: one.name });
  if (!failed) document.getElementById("models")?.scrollIntoView({ block: "nearest" });
}

function detail(one, titles) {
  const named = (id) => titles?.[id] || id;
  const lines = [
    one.why_not ? `${one.why_not[0].toUpperCase()}${one.why_not.slice(1)}.` : `p ${one.p < 1e-12 ? "< 1e-12" : `= ${number(one.p, 2)}`}.`,
    one.look_alikes.length ? `Look-alikes in general: ${one.look_alikes.map(named).join(", ")}.` : "",
  ].filter(Boolean);
  return h("span", { class: "soft detail" }, lines.join(" "));
}
