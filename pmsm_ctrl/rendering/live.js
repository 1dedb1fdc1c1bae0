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
    const floats = (text) => new Float32Array(Uint8Array.from(atob(text), (one) => one.charCodeAt(0)).buffer);
    // a finger that moves over a panel scrolls the page; it zooms after a touch on the panel's tool
    if (matchMedia("(pointer: coarse)").matches) {
      for (const name of ["upper", "middle", "lower", "scatter"]) model(name).toolbar.active_drag = null;
    }
    const switches = [...part.querySelectorAll("input[data-part]")];
    const menu = (name) => part.querySelector(`[data-role=${name}]`);
    const chosen = (name) => menu(name)?.selectedIndex ?? 0;
    const output = part.querySelector("output");
    const number = (k) => (k < 10 ? k.toPrecision(3) : k.toFixed(1)) + " %";

    // rms of the residual with some parts switched off: it is the residual with all of them plus those parts
    function error(balance, off) {
      const rows = [0, ...off.map((name) => balance.parts.indexOf(name) + 1).filter((n) => n > 0)];
      let sum = 0;
      for (const a of rows) for (const b of rows) sum += balance.products[a][b];
      return (100 * Math.sqrt(Math.max(sum, 0))) / balance.size;
    }

    function update() {
      const record = facts.records[chosen("record")];
      const wanted = facts.records[0].balances[chosen("balance")].name;
      const balance = record.balances.find((one) => one.name === wanted) ?? record.balances[0];
      const off = switches.filter((one) => !one.checked).map((one) => one.dataset.part);
      const measured = floats(balance.measured);
      const predicted = floats(balance.predicted);
      for (const name of off) if (Object.hasOwn(balance.parts, name)) floats(balance.parts[name]).forEach((value, i) => (predicted[i] -= value));
      const residual = measured.map((value, i) => value - predicted[i]);
      const speed = floats(record.over[0]);
      const direction = Array.from(speed, (value) => (value < 0 ? "#D55E00" : "#0072B2"));
      const over = floats(record.over[chosen("coordinate")]);
      source.data = { t: floats(record.t), measured, predicted, residual, speed, direction, over };
      model("upper").left[0].axis_label = `${balance.name} [${balance.unit}]`;
      model("middle").left[0].axis_label = `residual [${balance.unit}]`;
      const against = chosen("against"); // 0: the residual itself, as dots; or a second coordinate, as a map
      model("dots").visible = !against;
      model("map").visible = against > 0;
      const most = against ? tiles(over, floats(record.over[against - 1]), residual) : 0;
      model("scatter").left[0].axis_label = against ? menu("coordinate").options[against - 1].text : `residual [${balance.unit}]`;
      const colours = `; colour: mean residual, -${most.toPrecision(2)} (orange) to ${most.toPrecision(2)} ${balance.unit} (blue)`;
      model("scatter").below[0].axis_label = menu("coordinate").value + (against ? colours : "");
      meter(balance.name, off);
    }

    // means of the drawn residual in tiles over two coordinates; returns the largest one, which has the full colour
    function tiles(x, y, residual) {
      const [columns, rows] = [36, 18];
      const place = (values, count) => {
        const low = values.reduce((a, b) => Math.min(a, b), Infinity);
        const width = (values.reduce((a, b) => Math.max(a, b), -Infinity) - low) / count || 1;
        return { low, width, of: (value) => Math.min(count - 1, Math.floor((value - low) / width)) };
      };
      const [across, up] = [place(x, columns), place(y, rows)];
      const sums = new Map();
      residual.forEach((value, i) => {
        const key = across.of(x[i]) * rows + up.of(y[i]);
        const [sum, count] = sums.get(key) ?? [0, 0];
        sums.set(key, [sum + value, count + 1]);
      });
      const keys = [...sums.keys()];
      const mean = keys.map((key) => sums.get(key)[0] / sums.get(key)[1]);
      const most = mean.reduce((a, b) => Math.max(a, Math.abs(b)), 0) || 1;
      const shade = (value, full) => full.map((part) => Math.round(255 + (part - 255) * Math.min(1, Math.abs(value) / most)));
      model("tiles").data = {
        x: keys.map((key) => across.low + (Math.floor(key / rows) + 0.5) * across.width),
        y: keys.map((key) => up.low + ((key % rows) + 0.5) * up.width),
        width: keys.map(() => across.width),
        height: keys.map(() => up.width),
        mean,
        count: keys.map((key) => sums.get(key)[1]),
        color: mean.map((value) => `rgb(${shade(value, value < 0 ? [213, 94, 0] : [0, 114, 178])})`),
      };
      return most;
    }

    // the error on the fitted record and on those that were held out, as bars and in words
    function meter(name, off) {
      const groups = facts.errors.filter((one) => one.balances[name]).map((one) => ({ name: one.name, balance: one.balances[name] }));
      const here = off.filter((effect) => groups.some((one) => one.balance.parts.includes(effect)));
      const all = groups.map((one) => error(one.balance, []));
      const now = groups.map((one) => error(one.balance, here));
      const widest = 1.05 * Math.max(...now, ...all, ...groups.map((one) => error(one.balance, one.balance.parts)));
      part.querySelectorAll(".track").forEach((track, k) => {
        track.querySelector(".fill").style.width = k < now.length ? (100 * now[k]) / widest + "%" : 0;
        track.querySelector(".floor").style.left = k < now.length ? (10000 * groups[k].balance.floor) / widest + "%" : 0;
      });
      const each = (values) => values.map((value, k) => (values.length > 1 ? `${groups[k].name} ` : "") + number(value)).join(", ");
      output.textContent = `${name} error ${here.length ? `without ${here.join(", ")}` : "with all effects"}: ${each(now)}` +
        (here.length ? (now.length > 1 ? ` (with all effects: ${each(all)})` : `, ${each(all)} with all effects`) : "") +
        `; noise floor ${number(100 * groups[0].balance.floor)}`;
    }

    const ends = () => [facts.records[chosen("record")].start, facts.records[chosen("record")].stop];
    function enter() {
      const [start, end] = ends();
      time.setv({ bounds: null });
      time.setv({ start, end });
      time.setv({ bounds: [start, end] });
      for (const button of part.querySelectorAll("button[data-record]")) button.hidden = +button.dataset.record !== chosen("record");
      update();
    }

    for (const one of switches) one.addEventListener("change", update);
    for (const name of ["balance", "coordinate", "against"]) menu(name)?.addEventListener("change", update);
    menu("record")?.addEventListener("change", enter);
    for (const button of part.querySelectorAll("button[data-start]")) {
      button.addEventListener("click", () => {
        const whole = ends();
        const [start, stop] = button.dataset.start === "" ? whole : [+button.dataset.start, +button.dataset.stop];
        const room = button.dataset.start === "" ? 0 : 0.5 * (stop - start);
        time.setv({ start: Math.max(whole[0], start - room), end: Math.min(whole[1], stop + room) });
      });
    }
    enter();
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
