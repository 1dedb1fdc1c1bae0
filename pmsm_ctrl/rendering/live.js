// Draws the interactive parts of a page and connects their switches. Bokeh is loaded before.
"use strict";
(() => {
  const parsed = (part, name) => JSON.parse(part.querySelector("script." + name).textContent);

  async function draw(part) {
    const facts = parsed(part, "facts");
    part.hidden = false;
    await Bokeh.embed.embed_item(parsed(part, "document"));
    const model = Bokeh.documents.map((d) => (name) => d.get_model_by_name(part.id + "-" + name)).find((get) => get("source"));
    const source = model("source");
    const time = model("time");
    const whole = [time.start, time.end];
    // a finger that moves over a panel scrolls the page; it zooms after a touch on the panel's tool
    if (matchMedia("(pointer: coarse)").matches) {
      for (const name of ["upper", "middle", "lower", "scatter"]) model(name).toolbar.active_drag = null;
    }
    const switches = [...part.querySelectorAll("input[data-part]")];
    const balances = part.querySelector("[data-role=balance]");
    const output = part.querySelector("output");
    const number = (k) => (k < 10 ? k.toPrecision(3) : k.toFixed(1)) + " %";

    // rms of the residual with some parts switched off: it is the residual with all of them plus those parts
    function error(balance, off) {
      let sum = 0;
      const rows = [0, ...off.map((n) => n + 1)];
      for (const a of rows) for (const b of rows) sum += balance.products[a][b];
      return (100 * Math.sqrt(Math.max(sum, 0))) / balance.size;
    }

    function update() {
      const k = balances ? balances.selectedIndex : 0;
      const balance = facts.balances[k];
      const names = switches.filter((s) => !s.checked).map((s) => s.dataset.part);
      const off = names.map((name) => balance.parts.indexOf(name)).filter((n) => n >= 0);
      const data = { ...source.data };
      data.measured = data["measured" + k];
      data.predicted = Float32Array.from(data["predicted" + k]);
      for (const n of off) {
        const part_of = data[`part${k}_${n}`];
        for (let i = 0; i < part_of.length; i++) data.predicted[i] -= part_of[i];
      }
      data.residual = data.measured.map((value, i) => value - data.predicted[i]);
      source.data = data;
      model("upper").left[0].axis_label = `${balance.name} [${balance.unit}]`;
      for (const name of ["middle", "scatter"]) model(name).left[0].axis_label = `residual [${balance.unit}]`;
      const all = error(balance, []);
      const none = error(balance, balance.parts.map((_, n) => n));
      const now = error(balance, off);
      const widest = 1.05 * Math.max(now, none, all);
      part.querySelector(".fill").style.width = (100 * now) / widest + "%";
      part.querySelector(".floor").style.left = (10000 * balance.floor) / widest + "%";
      const without = off.length ? `without ${off.map((n) => balance.parts[n]).join(", ")}` : "with all effects";
      output.textContent = `${balance.name} error ${without}: ${number(now)}` +
        (off.length ? `, ${number(all)} with all effects` : "") + `; noise floor ${number(100 * balance.floor)}`;
    }

    for (const one of switches) one.addEventListener("change", update);
    if (balances) balances.addEventListener("change", update);
    part.querySelector("[data-role=coordinate]").addEventListener("change", (event) => {
      const list = event.target;
      source.data = { ...source.data, over: source.data["over" + list.selectedIndex] };
      model("scatter").below[0].axis_label = list.value;
    });
    for (const button of part.querySelectorAll("button[data-start]")) {
      button.addEventListener("click", () => {
        const [start, stop] = button.dataset.start === "" ? whole : [+button.dataset.start, +button.dataset.stop];
        const room = button.dataset.start === "" ? 0 : 0.5 * (stop - start);
        time.setv({ start: Math.max(whole[0], start - room), end: Math.min(whole[1], stop + room) });
      });
    }
    update();
    part.dataset.drawn = "yes";
  }

  const fail = (part) => (why) => {
    part.hidden = true;
    console.error(why);
  };
  // a part inside a folded section has no size yet: it is drawn when the section is opened
  function drawWhenOpen(part) {
    const folded = part.closest("details:not([open])");
    part.hidden = false;
    if (folded) folded.addEventListener("toggle", () => drawWhenOpen(part), { once: true });
    else draw(part).catch(fail(part));
  }
  const begin = () => document.querySelectorAll(".live").forEach(drawWhenOpen);
  if (document.readyState === "loading") addEventListener("DOMContentLoaded", begin);
  else begin();
})();
