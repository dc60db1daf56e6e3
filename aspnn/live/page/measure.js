// Range and bearing: from own ship to the pointer; a click begins there instead, the next one holds, Escape or the button ends.

import { byId, direction, distance } from "./format.js";
import { at, feature, rangeAndBearing } from "./geometry.js";

const { Point, LineString } = ol.geom;

export class Measure {
  constructor(chart) {
    this.chart = chart;
    this.on = false;
    this.from = null; // null: own ship
    this.to = null;
    this.held = false;
    chart.map.on("pointermove", (event) => {
      if (!this.on || this.held || event.dragging) return;
      this.to = ol.proj.toLonLat(event.coordinate);
      this.draw();
    });
    chart.map.on("click", (event) => {
      if (!this.on) return;
      const place = ol.proj.toLonLat(event.coordinate);
      if (this.held || this.from === null) {
        this.from = place;
        this.held = false;
      } else {
        this.held = true;
      }
      this.to = place;
      this.draw();
    });
  }

  toggle(on = !this.on) {
    Object.assign(this, { on, from: null, to: null, held: false });
    byId("measure").setAttribute("aria-pressed", on);
    this.draw();
  }

  draw() {
    const own = this.chart.situation?.own;
    const from = this.from ?? (own ? [own.lon, own.lat] : null);
    if (!this.on || !from || !this.to) {
      this.chart.put("tool", []);
      return;
    }
    const { range, bearing } = rangeAndBearing(from, this.to);
    const line = feature(new LineString([at(from), at(this.to)]), "measure");
    this.chart.put("tool", [line, feature(new Point(at(this.to)), "measure-name", `${direction(bearing)}°  ${distance(range)}`)]);
  }
}
