// Step 1: the design, from an example, a file or the form of a datasheet.
import { fill, h, send } from "./dom.js";

let machine = "motor";
let wrong = {};
let entered = {};

export function showDesign(section, app) {
  const { state, about } = app;
  fill(section, [state.design, wrong, machine, about.sessions.length], () => [
    h("div", { class: "columns" },
      h("div", {}, h("h2", {}, "Which drive is it?"), h("p", { class: "lead" }, "The design holds the values of the datasheet: inertia, flux, resistance, the effects that are known."), sources(app), form(app)),
      h("div", {}, current(app), earlier(app)),
    ),
  ]);
}

function sources(app) {
  const choice = h("select", { id: "example" }, app.about.examples.map((name) => h("option", {}, name)));
  choice.value = "seed_motor";
  const take = async (file) => {
    const failed = await app.act("design", { toml: await file.text(), name: file.name });
    if (!failed) next(app);
  };
  return h("div", { class: "cards" },
    h("div", { class: "card" },
      h("h3", {}, h("label", { for: "example" }, "Take an example")),
      h("div", { class: "row" }, choice,
        h("button", { type: "button", id: "use-example", onclick: async () => (await app.act("design", { example: choice.value })) || next(app) }, "Use it")),
    ),
    h("div", { class: "card drop", ...dropping((files) => files[0] && take(files[0])) },
      h("h3", {}, "Open a design (TOML)"),
      files("toml", "Choose a design file", { accept: ".toml,text/plain" }, ([file]) => file && take(file)),
    ),
  );
}

function next(app) {
  wrong = {};
  app.go("logs");
}

// A button that opens the browser's choice of files. The browser's own field is not shown: it is made anew with the page,
// and would say "No file chosen" beside files that were taken.
export const files = (id, words, attributes, take) => h("span", { class: "files" },
  h("input", { type: "file", id, class: "hidden", ...attributes, onchange: (event) => take([...event.target.files]) }),
  h("label", { for: id }, words));

export function dropping(take) {
  const mark = (on) => (event) => {
    event.preventDefault();
    event.currentTarget.classList.toggle("over", on);
  };
  return {
    ondragover: mark(true),
    ondragleave: mark(false),
    ondrop: (event) => {
      mark(false)(event);
      take([...event.dataTransfer.files]);
    },
  };
}

function form(app) {
  const kinds = app.about.form;
  const kind = kinds.find((one) => one.machine === machine);
  const kept = (key) => {
    if (entered[key]) return entered[key];
    const [, value, unit] = /^([-+\d.eE]*)\s*(.*)$/.exec(app.state.form?.answers?.[key] || "");
    return { value, unit };
  };
  const name = entered.name ?? app.state.form?.name ?? "axis";
  const rows = kind.questions.map((question) => field(question, kept(question.key)));
  const submit = async (event) => {
    event.preventDefault();
    const answers = {};
    entered = { name: document.getElementById("form-name").value }; // as typed, whether or not it can be read
    for (const question of kind.questions) {
      const value = document.getElementById(`q-${question.key}`).value.trim();
      const unit = document.getElementById(`u-${question.key}`)?.value || "";
      answers[question.key] = value ? `${value} ${unit}`.trim() : "";
      entered[question.key] = { value, unit };
    }
    const failed = await app.act("design", { machine, name: entered.name, answers });
    wrong = failed?.fields || {};
    if (!failed) return next(app);
    showDesign(document.getElementById("design"), app);
    document.querySelector("[aria-invalid=true]")?.focus();
  };
  return h("details", { class: "card", id: "sheet", open: Object.keys(wrong).length > 0 },
    h("summary", {}, h("h3", {}, "Fill in the datasheet")),
    h("form", { onsubmit: submit, novalidate: true },
      h("div", { class: "field" }, h("label", { for: "machine" }, "Kind of machine"),
        h("select", { id: "machine", onchange: (event) => { machine = event.target.value; wrong = {}; showDesign(document.getElementById("design"), app); document.getElementById("sheet").open = true; } },
          kinds.map((one) => h("option", { value: one.machine, selected: one.machine === machine }, one.words)))),
      h("div", { class: "field" }, h("label", { for: "form-name" }, "Name of the axis"), h("input", { id: "form-name", value: name, maxlength: "80", ...invalid("name") }), complaint("name")),
      rows,
      h("p", {}, h("button", { type: "submit", class: "main", id: "use-form" }, "Use these values")),
    ),
  );
}

const invalid = (key) => (wrong[key] ? { "aria-invalid": "true", "aria-describedby": `e-${key}` } : {});
const complaint = (key) => (wrong[key] ? h("p", { class: "complaint", id: `e-${key}` }, wrong[key]) : null);

function field(question, { value, unit }) {
  const { key, units } = question;
  const usual = /^([-+\d.eE]+)\s*(.*)$/.exec(question.default || "");
  const chosen = unit || usual?.[2] || units[0];
  const hint = question.needed ? "needed" : usual ? `${usual[1]} if left out` : "may be left out";
  return h("div", { class: "field" },
    h("label", { for: `q-${key}` }, question.text),
    h("div", { class: "row" },
      h("input", { id: `q-${key}`, inputmode: "decimal", autocomplete: "off", value, placeholder: hint, ...invalid(key) }),
      units.length > 1
        ? h("select", { id: `u-${key}`, "aria-label": `Unit of: ${question.text}` }, units.map((one) => h("option", { value: one, selected: one === chosen }, one)))
        : units.length ? [h("input", { type: "hidden", id: `u-${key}`, value: units[0] }), h("span", { class: "unit" }, units[0])] : null),
    complaint(key));
}

function current(app) {
  const { design } = app.state;
  if (!design) return h("div", { class: "card quiet" }, h("h2", {}, "No design yet"), h("p", {}, "Not sure? Take the example seed_motor, the motor of the reference paper, and look around."));
  return h("div", { class: "card" },
    h("h2", { id: "design-name" }, design.name),
    h("p", { class: "soft" }, `From ${design.origin}.`),
    design.doubts.length ? h("ul", { class: "doubts" }, design.doubts.map((text) => h("li", {}, text))) : null,
    h("p", {}, "Check what follows from the numbers:"),
    h("ul", { class: "facts" }, design.facts.map((text) => h("li", {}, text))),
    h("p", {}, `Effects in the design: ${design.effects.join(", ") || "none"}.`),
    h("details", { id: "toml-shown" }, h("summary", {}, "The design as TOML"), h("pre", { tabindex: "0" }, design.toml)),
    h("p", {}, h("button", { type: "button", class: "main", id: "to-logs", onclick: () => app.go("logs") }, "Next: logs")),
  );
}

async function remove(app, one) {
  if (!confirm(`Delete the session ${one.name || "without a design"} and its copies of ${one.logs} log${one.logs === 1 ? "" : "s"}?`)) return;
  try {
    app.about.sessions = (await send(`../${one.id}/`, {}, "DELETE")).sessions;
    showDesign(document.getElementById("design"), app);
  } catch (error) {
    app.complaint = error.message;
    app.refresh();
  }
}

function earlier(app) {
  const others = app.about.sessions.filter((one) => one.id !== app.state.id);
  if (!others.length) return null;
  return h("div", { class: "card" }, h("h2", {}, "Earlier sessions"),
    h("ul", { class: "plain" }, others.slice(0, 8).map((one) =>
      h("li", {}, h("a", { href: `../${one.id}/` }, one.name || "without a design"), h("span", { class: "soft" }, ` ${one.logs} log${one.logs === 1 ? "" : "s"}, ${new Date(1000 * one.changed).toLocaleString()} `),
        h("button", { type: "button", class: "plain", "aria-label": `Delete the session ${one.name} with its logs`, onclick: () => remove(app, one) }, "Delete")))),
    h("p", {}, h("a", { href: "../../" }, "New session")));
}
