// Elements from plain values: what comes from a file is set as text, never as markup.
export function h(tag, attributes = {}, ...children) {
  const svg = ["svg", "path", "rect", "line"].includes(tag);
  const element = svg ? document.createElementNS("http://www.w3.org/2000/svg", tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "style") for (const [key, one] of Object.entries(value)) element.style.setProperty(key, one);
    else if (name === "value") element.value = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  for (const child of children.flat(Infinity)) if (child !== null && child !== undefined && child !== false) element.append(child);
  return element;
}

// Fill a container anew where what it shows has changed; the focus stays on the element of the same id.
export function fill(container, key, make) {
  const text = JSON.stringify(key);
  if (container.dataset.key === text) return false;
  container.dataset.key = text;
  const focused = container.contains(document.activeElement) ? document.activeElement.id : "";
  const opened = new Set([...container.querySelectorAll("details[open][id]")].map((one) => one.id));
  const scrolled = [...container.querySelectorAll("[data-scroll]")].map((one) => [one.dataset.scroll, one.scrollTop]);
  container.replaceChildren(...[make()].flat(Infinity).filter(Boolean));
  for (const one of container.querySelectorAll("details[id]")) if (opened.has(one.id)) one.open = true;
  for (const [name, top] of scrolled) {
    const again = container.querySelector(`[data-scroll="${name}"]`);
    if (again) again.scrollTop = top;
  }
  if (focused) document.getElementById(focused)?.focus({ preventScroll: true });
  return true;
}

export const percent = (share) => {
  const value = 100 * share;
  if (!Number.isFinite(value)) return "–";
  return `${value !== 0 && Math.abs(value) < 0.1 ? value.toPrecision(1) : value.toFixed(Math.abs(value) < 10 ? 2 : 1)} %`;
};

export const number = (value, digits = 4) => {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return String(Number(value.toPrecision(digits)));
};

export const size = (bytes) => (bytes < 1e6 ? `${(bytes / 1e3).toFixed(0)} kB` : `${(bytes / 1e6).toFixed(1)} MB`);

export class Refused extends Error {
  constructor(text, fields) {
    super(text);
    this.fields = fields || {};
  }
}

async function answered(response) {
  const text = await response.text();
  let data = {};
  try {
    data = JSON.parse(text);
  } catch {
    data = { error: text.trim() || `the server answered ${response.status}` };
  }
  if (!response.ok) throw new Refused(data.error || `the server answered ${response.status}`, data.fields);
  return data;
}

export const GONE = "The server does not answer. Start it again with pmsm-ctrl workbench; what was entered is kept.";

async function reach(path, options) {
  try {
    return await fetch(path, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Refused(GONE);
  }
}

export const get = async (path) => answered(await reach(path));

export const send = async (path, body, method = "POST") =>
  answered(await reach(path, { method, body: body instanceof Blob ? body : JSON.stringify(body) }));

// Columns of doubles behind a head in JSON, as the server packs them.
export async function columns(path, signal) {
  const response = await reach(path, { signal });
  if (!response.ok) await answered(response);
  const buffer = await response.arrayBuffer();
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let place = 4 + length;
  const out = {};
  for (const [name, count] of Object.entries(head.columns)) {
    out[name] = new Float64Array(buffer, place, count);
    place += 8 * count;
  }
  return out;
}

export const query = (values) => new URLSearchParams(Object.entries(values).filter(([, v]) => v !== "" && v !== null && v !== undefined)).toString();
