// The page: one situation message after the other, drawn; buttons and keys.

import { drawTurn, EngineDial, RudderDial } from "./dials.js";
import { byId, element, known, notice, paint, write } from "./format.js";
import { drawLegend } from "./legend.js";
import { ask, Link } from "./link.js";
import { drawAlarms, drawCounts, drawNumerals, drawScores, drawTargets } from "./lists.js";
import { ChartMap, LAYERS } from "./map.js";
import { Measure } from "./measure.js";
import { Strips } from "./strips.js";
import { WhatIf } from "./whatif.js";

const wanted = new URLSearchParams(location.search);
const remembered = (name, first) => wanted.get(name) ?? localStorage.getItem(`aspnn.${name}`) ?? first;
const remember = (name, value) => localStorage.setItem(`aspnn.${name}`, value);

const valid = (value, values) => (values.includes(value) ? value : values[0]);

paint(valid(remembered("palette", "day"), ["day", "dusk", "night"]));
const chart = new ChartMap();
const measure = new Measure(chart);
const strips = new Strips();
const rudder = new RudderDial((angle, final) => {
  if (whatif.on) whatif.wish(angle);
  else if (final) order({ rudder: angle });
});
const engine = new EngineDial((rpm) => order({ shaft: rpm / 60 }));
const whatif = new WhatIf(chart, rudder, (angle) => order({ rudder: angle }));
let situation = null;

// Orders to a simulated ship that no message tells of yet: the next press of a key goes on from here.
const asked = {};
const TOLD = 1500; // ms until the messages are believed again, whatever they say

async function order(what) {
  if (!situation?.simulated) return;
  Object.assign(asked, what, { until: performance.now() + TOLD });
  drawDials();
  try {
    await ask("api/order", what);
  } catch (error) {
    notice(`Order: ${error.message}`);
    asked.until = 0;
  } finally {
    if (!whatif.on) rudder.wish = null;
    drawDials();
  }
}

function ordered() {
  const { rudder_order: angle, shaft_order: shaft } = situation.simulated;
  if (performance.now() > (asked.until ?? 0)) Object.assign(asked, { rudder: undefined, shaft: undefined });
  return { rudder: asked.rudder ?? angle, shaft: asked.shaft ?? shaft };
}

const perMinute = (value) => (known(value) ? value * 60 : null);

function drawDials() {
  const { own, rudder: stops, simulated } = situation;
  if (stops) whatif.max = stops.max;
  if (known(situation.horizon)) whatif.horizon = situation.horizon;
  byId("plan-give").hidden = !simulated;
  const given = simulated ? ordered() : { rudder: own?.rudder_order, shaft: null };
  rudder.draw({ value: own?.rudder_angle, order: given.rudder, max: stops?.max ?? 35, live: whatif.on || simulated !== null });
  const most = Math.max(perMinute(simulated?.shaft_max) ?? 0, 60 * Math.ceil(Math.abs(own?.shaft ?? 0)), 60);
  engine.draw({ value: perMinute(own?.shaft), order: perMinute(given.shaft), max: most, live: simulated !== null });
  drawTurn(own?.rot);
}

function fillLimits() {
  const { limits } = situation;
  if (!limits || document.activeElement?.closest(".limits")) return;
  byId("limit-cpa").value = Math.round(limits.cpa);
  byId("limit-tcpa").value = Math.round(limits.tcpa / 60);
}

// Each part by itself: one that cannot be drawn leaves the others alive. Lists are read, so they change no faster than eyes can follow.
const PARTS = [(message) => chart.update(message), () => measure.draw(), drawNumerals, drawDials, drawAlarms];
const LISTS = [drawTargets, drawScores, drawCounts, (message) => strips.update(message), fillLimits];
const READ = 450; // ms between two drawings of the lists
let listed = -Infinity;

function draw(message) {
  situation = message;
  const now = performance.now();
  const due = now - listed >= READ;
  if (due) listed = now;
  for (const part of due ? [...PARTS, ...LISTS] : PARTS) {
    try {
      part(message);
    } catch (error) {
      console.error(error);
      notice(`A part of the picture cannot be drawn: ${error.message}`);
    }
  }
  document.body.dataset.sequence = message.sequence;
}

const BANNERS = { old: "OWN SHIP NOT UPDATED: no new state", stale: "STALE: no data", lost: "NO CONNECTION: no data" };

function tell(state, age) {
  document.body.dataset.link = state;
  byId("banner").hidden = state === "live";
  write("banner", state === "live" ? "" : `${BANNERS[state]} ${age === null ? "yet" : `for ${Math.round(age / 1000)} s`}`);
}

function choose(group, name, set) {
  const buttons = [...byId(group).querySelectorAll("button")];
  const press = (value) => {
    buttons.forEach((button) => button.setAttribute("aria-pressed", button.dataset.value === value));
    remember(name, value);
    set(value);
  };
  buttons.forEach((button) => button.addEventListener("click", () => press(button.dataset.value)));
  return press;
}

const turn = choose("orientation", "up", (value) => chart.turn(value));
const light = choose("palette", "palette", (value) => {
  paint(value);
  chart.paint();
  strips.build();
  if (situation) strips.update(situation);
});
turn(valid(remembered("up", "north"), ["north", "head", "course"]));
light(document.documentElement.dataset.palette);

for (const [name, title, first] of LAYERS) {
  const box = element("input", { type: "checkbox" });
  box.checked = remembered(`show.${name}`, String(first)) === "true";
  const set = () => {
    remember(`show.${name}`, String(box.checked));
    chart.show(name, box.checked);
  };
  box.addEventListener("change", set);
  set();
  byId("counts").before(element("label", {}, box, ` ${title}`));
}
drawLegend();
const KEYS = [["← →", "rudder 5°"], ["↑ ↓", "engine 10 %"], ["+ −", "range"], ["C", "centre"], ["R", "range / bearing"], ["W", "what if"], ["Esc", "tool off"]];
for (const [key, what] of KEYS) byId("keys").append(element("dt", {}, key), element("dd", {}, what));

async function limit() {
  const cpa = Number(byId("limit-cpa").value);
  const tcpa = Number(byId("limit-tcpa").value) * 60;
  try {
    await ask("api/limits", { cpa, tcpa });
  } catch (error) {
    notice(`Limits: ${error.message}`);
  }
}

byId("limit-cpa").addEventListener("change", limit);
byId("limit-tcpa").addEventListener("change", limit);
byId("nearer").addEventListener("click", () => chart.zoom(1 / 1.5));
byId("further").addEventListener("click", () => chart.zoom(1.5));
byId("centre").addEventListener("click", () => chart.centre());
byId("measure").addEventListener("click", () => measure.toggle());
byId("whatif").addEventListener("click", () => whatif.toggle());
byId("show").addEventListener("click", () => {
  byId("layers").hidden = !byId("layers").hidden;
  byId("show").setAttribute("aria-pressed", !byId("layers").hidden);
});

const step = (value, by, most) => Math.max(-most, Math.min(most, Math.round(value + by)));
const keys = {
  "+": () => chart.zoom(1 / 1.5),
  "-": () => chart.zoom(1.5),
  c: () => chart.centre(),
  r: () => measure.toggle(),
  w: () => whatif.toggle(),
  Escape: () => {
    measure.toggle(false);
    if (whatif.picking) whatif.pick(false);
  },
  ArrowLeft: () => helm(-5),
  ArrowRight: () => helm(5),
  ArrowUp: () => telegraph(0.1),
  ArrowDown: () => telegraph(-0.1),
};

function helm(by) {
  const { max } = rudder;
  if (whatif.on) whatif.wish(step(rudder.wish ?? rudder.last.order ?? 0, by, max));
  else if (situation?.simulated) order({ rudder: step(ordered().rudder ?? 0, by, max) });
}

function telegraph(share) {
  const most = situation?.simulated?.shaft_max;
  if (!known(most) || !known(ordered().shaft)) return;
  order({ shaft: Math.max(-most, Math.min(most, ordered().shaft + share * most)) });
}

document.addEventListener("keydown", (event) => {
  if (event.target instanceof HTMLInputElement || event.ctrlKey || event.altKey || event.metaKey) return;
  const action = keys[event.key] ?? keys[event.key.toLowerCase()];
  if (!action) return;
  event.preventDefault();
  action();
});

globalThis.aspnn = { chart, strips, whatif, draw }; // for the console, and for whoever tests the page
new Link(draw, tell);
