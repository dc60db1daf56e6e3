// The chart: which way it points, how far it reaches, its layers; what is on them says features.js, how it looks looks.js.

import * as features from "./features.js";
import { byId, drawing, known, notice } from "./format.js";
import { at, away, metres } from "./geometry.js";
import { ask } from "./link.js";
import { inChartOrder, Looks, ofChart } from "./looks.js";

// What can be shown or not: layer, name, shown at first.
export const LAYERS = [
  ["swept", "Swept area", true],
  ["region", "95 % region", true],
  ["outlines", "Predicted ship every 10 s", true],
  ["arc", "Predicted vector (rate-of-turn arc)", true],
  ["pivot", "Pivot point", true],
  ["track", "Past track", true],
  ["targets", "Targets", true],
  ["chart", "Chart", true],
];
// From the lowest to the topmost, with what puts features on it with each message.
const DRAWN = [
  ["chart", null],
  ["region", features.ofRegion],
  ["swept", features.ofSwept],
  ["track", features.ofTrack],
  ["arc", features.ofArc],
  ["outlines", features.ofForecast],
  ["fan", null],
  ["targets", features.ofTargets],
  ["own", features.ofOwn],
  ["pivot", features.ofPivot],
  ["tool", null],
];
const RESTLESS = 10; // deg: course up turns in steps of this, so that the picture stands still
const STEERING = 0.3; // m/s: slower, the course over ground says nothing

export class ChartMap {
  constructor() {
    this.follow = true;
    this.mode = "north";
    this.sources = {};
    this.layers = {};
    this.situation = null;
    this.course = null;
    this.looks = new Looks();
    for (const [name] of DRAWN) {
      const source = new ol.source.Vector({ features: [], useSpatialIndex: name === "chart" });
      const declutter = name === "fan"; // of its many names those that lie on others are left out
      const style = name === "chart" ? ofChart : (feature) => this.looks.of(feature);
      this.sources[name] = source;
      this.layers[name] = new ol.layer.Vector({ source, style, declutter, updateWhileAnimating: true, updateWhileInteracting: true });
    }
    this.view = new ol.View({ center: [0, 0], resolution: 3, minResolution: 0.1, maxResolution: 400, constrainRotation: false });
    this.map = new ol.Map({
      target: "map",
      layers: DRAWN.map(([name]) => this.layers[name]),
      view: this.view,
      controls: [new ol.control.ScaleLine({ units: "nautical", minWidth: 90 })],
      interactions: ol.interaction.defaults.defaults({ altShiftDragRotate: false, pinchRotate: false, doubleClickZoom: false, keyboard: false }),
    });
    this.map.on("pointerdrag", () => (this.follow = false));
    this.view.on("change:resolution", () => {
      this.drawShips(); // outlines become symbols and back
      this.place();
    });
    this.map.on("change:size", () => this.place());
  }

  paint() {
    this.looks.paint();
    for (const layer of Object.values(this.layers)) layer.changed();
  }

  put(name, made) {
    const source = this.sources[name];
    source.clear(true);
    source.addFeatures(made);
  }

  async readChart() {
    try {
      const read = new ol.format.GeoJSON().readFeatures(await ask("api/chart"), { featureProjection: "EPSG:3857" });
      this.put("chart", inChartOrder(read));
    } catch (error) {
      this.put("chart", []);
      notice(`Chart: ${error.message}`);
    }
  }

  // Metres on the ground to the pixel where own ship is.
  get scale() {
    return metres(this.view.getResolution(), this.situation?.own?.lat ?? 0);
  }

  update(situation) {
    const first = !this.situation?.own;
    if ((situation.chart ?? null) !== (this.situation?.chart ?? null)) {
      if (situation.chart) this.readChart();
      else this.put("chart", []);
    }
    this.situation = situation;
    this.place(first);
    for (const [name, made] of DRAWN) if (made) this.put(name, made(situation, this.scale));
  }

  drawShips() {
    if (!this.situation) return;
    this.put("own", features.ofOwn(this.situation, this.scale));
    this.put("targets", features.ofTargets(this.situation, this.scale));
  }

  showFan(answer, chosen, place) {
    this.put("fan", features.ofFan(answer, chosen, place));
  }

  // Own ship where she belongs: below the middle when she points up, and otherwise so that there is room ahead of her.
  place(fit = false) {
    const own = this.situation?.own;
    const size = this.map.getSize();
    if (!known(own?.lat) || !size) return;
    if (fit) {
      const reach = Math.max((own.sog ?? 0) * (this.situation.horizon ?? 90), 4 * own.length);
      this.view.setResolution((reach * 1.9) / Math.min(...size) / metres(1, own.lat));
    }
    if (known(own.cog) && (own.sog ?? 0) > STEERING) {
      const turn = this.course === null ? 0 : ((own.cog - this.course + 540) % 360) - 180;
      if (this.course === null || Math.abs(turn) > RESTLESS) this.course = own.cog;
    }
    const up = { north: 0, head: own.heading, course: this.course ?? own.heading }[this.mode] ?? 0;
    this.view.setRotation((-up * Math.PI) / 180);
    this.drawNorth(up);
    if (!this.follow) return;
    const ahead = 0.24 * size[1] * metres(this.view.getResolution(), own.lat);
    this.view.setCenter(at(away([own.lon, own.lat], this.mode === "north" ? (own.heading ?? 0) : up, ahead)));
  }

  drawNorth(up) {
    const place = byId("north");
    if (!place.firstChild) {
      const arrow = drawing("g");
      arrow.append(drawing("path", { d: "M0 -12L7 18L0 12L-7 18Z" }), drawing("text", { y: -15 }, "N"));
      place.append(arrow);
    }
    place.firstChild.setAttribute("transform", `rotate(${(-up).toFixed(1)})`);
  }

  turn(mode) {
    this.mode = mode;
    this.course = null;
    this.place();
  }

  centre() {
    this.follow = true;
    this.place();
  }

  zoom(factor) {
    this.view.setResolution(this.view.getResolution() * factor);
  }

  show(name, visible) {
    this.layers[name].setVisible(visible);
  }
}
