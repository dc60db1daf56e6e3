// How each thing on the chart looks. A feature says its `look`; those with words say them in `text`.

import { colour } from "./format.js";

const { Circle, Fill, RegularShape, Stroke, Style, Text } = ol.style;
const FONT = '"DejaVu Sans", "Segoe UI", Arial, sans-serif';
const MOST = 400; // styles with words that are kept for the next message

const fill = (name) => new Fill({ color: colour(name) });
const stroke = (name, width, lineDash = undefined) => new Stroke({ color: colour(name), width, lineDash });
const edge = (...of) => new Style({ stroke: stroke(...of) });
const cross = (radius, name, width, angle = 0) => new Style({ image: new RegularShape({ points: 4, radius, radius2: 0, angle, stroke: stroke(name, width) }) });
const circle = (radius, name, width, inside = undefined) => new Style({ image: new Circle({ radius, stroke: stroke(name, width), fill: inside && fill(inside) }) });

function words(text, name, { size = 15, weight = 500, x = 0, y = 0 } = {}) {
  const font = `${weight} ${size}px ${FONT}`;
  return new Text({ text, font, fill: fill(name), stroke: stroke("halo", 4), offsetX: x, offsetY: y, overflow: true });
}

// Lines, areas and marks, by look.
const plain = () => ({
  heading: edge("own", 1.2),
  hull: new Style({ stroke: stroke("own", 3), fill: fill("halo") }),
  // Two circles: the symbol of own ship where her outline would be too small (SN.1/Circ.243).
  symbol: [circle(10, "own", 2.5), circle(5, "own", 2.5)],
  antenna: cross(6, "own", 2),
  "antenna-silent": cross(6, "danger", 2.5),
  track: edge("track", 2),
  swept: new Style({ stroke: stroke("ours", 1), fill: fill("swept") }),
  region: new Style({ stroke: stroke("ours", 1.2, [2, 5]), fill: fill("region") }),
  ellipse: edge("ours", 1.2, [2, 4]),
  path: edge("ours", 3),
  outline: edge("ours", 1),
  "outline-major": edge("ours", 2.5),
  touch: cross(14, "danger", 4, Math.PI / 4),
  arc: edge("arc", 3, [9, 6]),
  "arc-outline": edge("arc", 1.5, [9, 6]),
  pivot: circle(6, "own", 2, "halo"),
  "pivot-later": circle(3.5, "ours", 2, "halo"),
  "target-path": edge("target", 2, [6, 4]),
  "target-hull": edge("target", 2),
  "target-later": edge("target", 1),
  "danger-path": edge("danger", 2.5, [6, 4]),
  "danger-hull": edge("danger", 3),
  "danger-later": edge("danger", 1),
  fan: edge("quiet", 1.5),
  "fan-touches": edge("danger", 1.5),
  "fan-chosen": edge("plan", 3.5),
  plan: edge("plan", 3.5),
  "plan-outline": edge("plan", 1.5),
  "plan-area": new Style({ fill: fill("plan-swept") }),
  spot: cross(10, "plan", 3),
  measure: edge("text", 2, [10, 5]),
});

// Words, and what is drawn with them, by look.
const worded = {
  mark: (text) => new Style({ text: words(text, "ours", { size: 19, weight: 600 }) }),
  "target-name": (text) => new Style({ text: words(text, "target", { y: 24 }) }),
  "danger-name": (text) => new Style({ text: words(text, "danger", { y: 24, weight: 600 }) }),
  cpa: (text) => new Style({ stroke: stroke("danger", 1.5, [3, 4]), text: words(text, "danger", { y: -12 }) }),
  "fan-name": (text) => new Style({ text: words(text, "quiet", { size: 14 }) }),
  "fan-touches-name": (text) => new Style({ text: words(text, "danger", { size: 14 }) }),
  "plan-name": (text) => new Style({ text: words(text, "plan", { size: 17, weight: 700 }) }),
  "measure-name": (text) => new Style({ text: words(text, "text", { size: 20, weight: 600, y: -20 }) }),
};

export class Looks {
  constructor() {
    this.paint();
  }

  // Styles hold colours, so a new palette makes them anew.
  paint() {
    this.plain = plain();
    this.worded = new Map();
  }

  of(feature) {
    const look = feature.get("look");
    const text = feature.get("text");
    if (text === undefined) return this.plain[look];
    const key = `${look} ${text}`;
    if (!this.worded.has(key)) {
      if (this.worded.size >= MOST) this.worded.clear();
      this.worded.set(key, worded[look](text));
    }
    return this.worded.get(key);
  }
}

const DEPTHS = [[5, "shoal5"], [10, "shoal10"]];

// A feature of the user's chart, by its kind (SITUATION.md); what has none is a plain line.
export function ofChart(feature) {
  const kind = feature.get("kind");
  const said = feature.get("name");
  const text = typeof said === "string" && said !== "" ? said : null;
  const under = text && words(text, "chart-text", { y: 17, size: 14 });
  if (kind === "land") return new Style({ fill: fill("land"), stroke: stroke("coast", 1.5) });
  if (kind === "shore") return edge("coast", 2);
  if (kind === "depth") {
    const shoal = DEPTHS.find(([depth]) => feature.get("depth") <= depth)?.[1] ?? "shoal20";
    return new Style({ fill: fill(shoal), stroke: stroke("contour", 1) });
  }
  if (kind === "berth") return new Style({ stroke: stroke("text", 4), text: text && words(text, "chart-text", { size: 15, x: 30 }) });
  if (kind === "buoy") return new Style({ image: new RegularShape({ points: 4, radius: 7, fill: fill("buoy"), stroke: stroke("halo", 1) }), text: under });
  if (kind === "danger") {
    const image = new RegularShape({ points: 4, radius: 8, radius2: 0, angle: Math.PI / 4, stroke: stroke("danger", 2.5) });
    return new Style({ image, stroke: stroke("danger", 2), text: under });
  }
  if (kind === "text") return new Style({ text: text && words(text, "chart-text", { size: 15 }) });
  return new Style({ stroke: stroke("contour", 1.5), image: new Circle({ radius: 3, fill: fill("contour") }), text: under });
}

// Shallow water over deep, land over water, all else on top.
export function inChartOrder(features) {
  const order = ["depth", "land", "shore", "berth"];
  const rank = (f) => (order.includes(f.get("kind")) ? order.indexOf(f.get("kind")) : order.length);
  const depth = (f) => (f.get("kind") === "depth" ? -(f.get("depth") ?? 0) : 0);
  return features.sort((a, b) => rank(a) - rank(b) || depth(a) - depth(b));
}
