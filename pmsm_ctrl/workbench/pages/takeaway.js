// Step 4: what can be taken away.
import { explained, titled } from "./compare.js";
import { fill, h } from "./dom.js";

const FILES = [
  ["design", "Design (TOML)", "The datasheet values with the refitted parameters and the effects that were added. For every command of pmsm-ctrl, and for step 1 of this page."],
  ["report", "Report (HTML)", "One page for a colleague: opens without this program and without a network."],
  ["json", "Result (JSON)", "Every number of the models and of the candidates, for programs."],
  ["script", "Steps (Python)", "A script that repeats every step of this session with the same logs."],
  ["st", "Compensator (Structured Text)", "Friction feedforward with the identified effects, IEC 61131-3."],
  ["c", "Compensator (C99)", "The same in C, with math.h alone."],
];

export function showTakeaway(section, app) {
  const { model, design } = app.state;
  fill(section, [model.names, model.models, design.name], () => [
    h("h2", {}, "Take away"),
    h("p", { class: "lead" }, model.names.length ? `${design.name} with ${model.names.map((name) => titled(model, name)).join(", ")}.` : `${design.name}, parameters refitted, no effect added.`),
    h("div", { class: "cards wide" }, FILES.map(([kind, title, text]) => h("div", { class: "card" }, h("h3", {}, title), h("p", {}, text), h("p", {}, button(app, kind, title))))),
    h("h2", {}, "Effects of the new design"),
    h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Effects of the new design" }, h("table", {},
      h("thead", {}, h("tr", {}, ["effect", "parameters", ""].map((text) => h("th", { scope: "col" }, text)))),
      h("tbody", {}, model.effects.map((one) => h("tr", {}, h("td", {}, one.title), h("td", {}, explained(one)), h("td", {}, one.given ? "given" : "added")))))),
  ]);
}

function button(app, kind, title) {
  const take = async (event) => {
    const pressed = event.currentTarget;
    pressed.disabled = true;
    try {
      const wanted = fetch(`take/${kind}`);
      app.refresh();
      const response = await wanted;
      if (!response.ok) throw new Error((await response.json()).error);
      const name = /filename="([^"]+)"/.exec(response.headers.get("content-disposition") || "")?.[1] || kind;
      const link = h("a", { href: URL.createObjectURL(await response.blob()), download: name });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    } catch (error) {
      app.complaint = error.message;
    }
    pressed.disabled = false;
    app.refresh();
  };
  return h("button", { type: "button", id: `take-${kind}`, "aria-label": `Download ${title}`, onclick: take }, "Download");
}
