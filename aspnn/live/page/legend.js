// What the lines on the chart mean, each drawn as it is on the chart.

import { byId, drawing, element } from "./format.js";

const HULL = "M2 6H28L36 10L28 14H2Z";
const ENTRIES = [
  ["Predicted path", [["rect", { x: 0, y: 4, width: 38, height: 12, class: "area" }], ["line", { x1: 0, x2: 38, y1: 10, y2: 10, class: "ours" }]]],
  ["Predicted ship", [["path", { d: HULL, class: "ship" }]]],
  ["95 % region", [["rect", { x: 1, y: 3, width: 36, height: 14, class: "bound" }]]],
  ["Predicted vector", [["line", { x1: 0, x2: 38, y1: 10, y2: 10, class: "vector" }]]],
  ["Pivot point", [["circle", { cx: 19, cy: 10, r: 6, class: "pivot" }]]],
  ["What if", [["line", { x1: 0, x2: 38, y1: 10, y2: 10, class: "plan" }]]],
];

export function drawLegend() {
  for (const [name, parts] of ENTRIES) {
    const sign = drawing("svg", { viewBox: "0 0 38 20" });
    sign.append(...parts.map(([shape, attributes]) => drawing(shape, attributes)));
    byId("legend").append(element("span", name === "What if" ? { class: "if" } : {}, sign, name));
  }
}
