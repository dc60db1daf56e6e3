// Numbers as they stand on a bridge, and small helpers for the document. What is not known is shown as a dash.

export const KNOT = 1852 / 3600; // m/s
export const MILE = 1852; // m
const DASH = "–";

export const known = (value) => typeof value === "number" && Number.isFinite(value);
export const number = (value, digits = 0) => (known(value) ? value.toFixed(digits) : DASH);
export const knots = (value, digits = 1) => number(known(value) ? value / KNOT : null, digits);

// Three figures, 000 to 359.9.
export function direction(value, digits = 1) {
  if (!known(value)) return DASH;
  const turned = ((value % 360) + 360) % 360;
  const text = turned.toFixed(digits);
  const round = Number(text) >= 360 ? (0).toFixed(digits) : text;
  return round.padStart(digits ? 4 + digits : 3, "0");
}

// An angle to either side: "P 10" or "S 10".
export function sided(value, digits = 0) {
  if (!known(value)) return DASH;
  const text = Math.abs(value).toFixed(digits);
  if (Number(text) === 0) return text;
  return `${value < 0 ? "P" : "S"} ${text}`;
}

// A distance: metres when near, nautical miles when far.
export function distance(value) {
  if (!known(value)) return DASH;
  return value < 1000 ? `${Math.round(value)} m` : `${(value / MILE).toFixed(2)} NM`;
}

// Whether a clearance is none: what is shown as 0 m.
export const touches = (near) => Boolean(near) && known(near.distance) && near.distance < 0.5;

// A time ahead: 45 s, 2:05.
export function ahead(value) {
  if (!known(value)) return DASH;
  const whole = Math.round(Math.abs(value));
  const sign = value < 0 ? "−" : "";
  return whole < 100 ? `${sign}${whole} s` : `${sign}${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

export function utc(seconds) {
  return known(seconds) ? `${new Date(seconds * 1000).toISOString().slice(11, 19)} UTC` : "--:--:-- UTC";
}

export const byId = (id) => document.getElementById(id);

// An element with attributes and children; text is set as text, so that nothing from outside becomes markup.
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children.map((child) => (child instanceof Node ? child : String(child))));
  return made;
}

export function drawing(name, attributes = {}, text = null) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== null) made.textContent = text;
  return made;
}

// Say `text` in a place of the document, unless it says so already: what does not change is not laid out again.
export function write(id, text) {
  const place = byId(id);
  if (place.textContent !== text) place.textContent = text;
}

const filled = new WeakMap();

// Put `make()` into a place of the document whenever `rows`, plain data of what is shown, are others than they were.
export function refill(place, rows, make) {
  const shown = JSON.stringify(rows);
  if (filled.get(place) === shown) return;
  filled.set(place, shown);
  place.replaceChildren(...make(rows));
}

// Colours of the palette, read once each: the chart asks for them with every picture.
const colours = new Map();

export function colour(name) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return colours.get(name);
}

export function paint(palette) {
  document.documentElement.dataset.palette = palette;
  colours.clear();
}

let hiding = 0;

// Say a line at the foot of the chart for a while; an empty one takes the last away.
export function notice(text) {
  const place = byId("notice");
  place.textContent = text;
  place.hidden = text === "";
  clearTimeout(hiding);
  hiding = setTimeout(() => (place.hidden = true), 8000);
}
