// The page: it asks the server for the state of its session and shows the step that is chosen.
import { GONE, get, h, send } from "./dom.js";
import { showDesign } from "./design.js";
import { showLogs, usable } from "./logs.js";
import { showCompare } from "./compare.js";
import { showTakeaway } from "./takeaway.js";
import { showLive } from "./live.js";

const STEPS = ["design", "logs", "compare", "take", "live"];
const VIEWS = { design: showDesign, logs: showLogs, compare: showCompare, take: showTakeaway, live: showLive };
const app = { state: null, about: null, step: "design", complaint: "", act, go, enter, refresh, upload };
let listening = false;

function go(step, focus = true) {
  if (!STEPS.includes(step)) return;
  app.step = step;
  if (location.hash !== `#${step}`) history.replaceState(null, "", `#${step}`);
  draw();
  scrollTo(0, 0);
  if (focus) document.querySelector(`[data-step=${step}]`)?.focus({ preventScroll: true });
}

// Do something that changes the session; what the server refuses is shown, and returned for the field it is about.
async function act(path, body, method) {
  app.complaint = "";
  try {
    app.state = await send(path, body, method);
    draw();
    listen();
    return null;
  } catch (error) {
    if (!Object.keys(error.fields || {}).length) app.complaint = error.message;
    draw();
    return error;
  }
}

async function upload(file) {
  app.uploading = file.name;
  draw();
  const failed = await act(`logs?name=${encodeURIComponent(file.name)}`, file, "PUT");
  app.uploading = "";
  draw();
  return failed;
}

async function refresh() {
  try {
    app.state = await get("state");
    if (app.complaint === GONE) app.complaint = "";
  } catch (error) {
    app.complaint = error.message;
  }
  draw();
  listen();
}

// While something is computed, wait for news.
async function listen() {
  if (listening) return;
  listening = true;
  while (app.state?.job) {
    try {
      app.state = await get(`state?since=${app.state.revision}`);
    } catch (error) {
      app.complaint = error.message;
      draw();
      break;
    }
    draw();
  }
  listening = false;
}

const DOING = { read: "Reading", step: "Fitting", find: "Searching for missing effects", take: "Preparing the file; a compensator's gain is proven by simulation, up to a minute" };

const PATIENCE = 6; // s after which a fit says why it may take long

function status() {
  const bar = document.getElementById("status");
  const job = app.state?.job;
  if (!job) app.since = 0;
  else if (!app.since) {
    app.since = performance.now();
    setTimeout(draw, 1000 * PATIENCE + 50);
  }
  const long = job?.kind === "step" && performance.now() - app.since > 1000 * PATIENCE;
  const text = app.complaint || app.state?.message || "";
  const busy = app.uploading ? `Uploading ${app.uploading} …` : job ? `${DOING[job.kind]}${job.name ? ` ${job.name}` : ""} …${long ? " The first fit after an installation compiles its code, about a minute." : ""}` : "";
  bar.hidden = !text && !busy;
  bar.className = text && !busy ? "bad" : "";
  const parts = [busy ? h("span", { class: "busy" }, busy) : text];
  if (job?.kind === "find") {
    const share = job.share ?? 0;
    parts.push(
      h("progress", { max: "1", value: share, "aria-label": "Share of the search that is done" }),
      h("button", { type: "button", id: "stop", disabled: !!job.stopping, onclick: () => act("stop", {}) }, job.stopping ? "Stopping …" : "Stop"),
    );
  } else if (text && !busy) {
    parts.push(h("button", { type: "button", class: "plain", "aria-label": "Dismiss this message", onclick: dismiss }, "×"));
  }
  bar.replaceChildren(...parts.filter(Boolean));
}

// A file was dropped where the page takes none.
function missed() {
  app.complaint = app.state?.design ? "Drop log files onto the field of step 2, Logs." : "A design comes first: take an example, open one or fill in the datasheet. Logs are dropped in step 2.";
  draw();
}

function dismiss() {
  app.complaint = "";
  if (app.state) app.state.message = "";
  draw();
}

function draw() {
  const { state } = app;
  status();
  if (!state) return;
  const subject = document.getElementById("subject");
  const count = state.logs.length;
  subject.textContent = state.design ? `${state.design.name}${count ? ` · ${count} log${count === 1 ? "" : "s"}` : ""}` : "";
  document.title = state.design ? `${state.design.name} – workbench` : "pmsm_ctrl workbench";
  const ready = { design: true, logs: !!state.design, compare: !!state.design && count > 0, take: !!state.model, live: app.about.live };
  for (const button of document.querySelectorAll("#steps button")) {
    const step = button.dataset.step;
    button.toggleAttribute("disabled", !ready[step]);
    if (step === "live") button.parentElement.hidden = !ready.live;
    if (step === app.step) {
      if (!button.hasAttribute("aria-current")) requestAnimationFrame(() => button.scrollIntoView({ block: "nearest", inline: "nearest" }));
      button.setAttribute("aria-current", "step");
    } else button.removeAttribute("aria-current");
  }
  if (!ready[app.step]) app.step = state.design ? (count ? "compare" : "logs") : "design";
  for (const step of STEPS) {
    const section = document.getElementById(step);
    section.hidden = step !== app.step;
    if (step === app.step) VIEWS[step](section, app);
  }
}

// The third step compares by itself where it can.
function enter(step) {
  go(step);
  const { state } = app;
  if (step === "compare" && !state.model && !state.job && usable(state)) act("steps", { begin: true });
}

async function begin() {
  for (const button of document.querySelectorAll("#steps button")) button.addEventListener("click", () => enter(button.dataset.step));
  addEventListener("hashchange", () => go(location.hash.slice(1), false));
  document.addEventListener("visibilitychange", () => !document.hidden && refresh());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    document.getElementById("compare").dataset.key = "";
    dispatchEvent(new Event("scheme"));
    draw();
  });
  // a file that misses its place must not replace the page, nor vanish without a word
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    if (!event.defaultPrevented && event.dataTransfer?.files.length) missed();
    event.preventDefault();
  });
  try {
    [app.about, app.state] = await Promise.all([get("about"), get("state")]);
  } catch (error) {
    app.complaint = error.message;
    status();
    return;
  }
  const wanted = location.hash.slice(1);
  app.step = STEPS.includes(wanted) ? wanted : app.state.model ? "compare" : app.state.logs.length ? "logs" : app.about.live ? "live" : "design";
  draw();
  listen();
  document.body.dataset.ready = "yes";
}

begin();
