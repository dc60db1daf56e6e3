// Rudder, engine and rate of turn. The needle is what is measured, the hollow mark what is ordered, the filled one what is asked "what if".

import { byId, drawing, known, number, sided } from "./format.js";

const RADIUS = 84;
const SPREAD = 62; // deg of the rudder dial to either side for the stops
const ROUND = 58; // radius of the engine dial
const FULL = 135; // deg of the engine dial to either side for full ahead and full astern

function point(angle, radius) {
  const a = (angle * Math.PI) / 180;
  return [radius * Math.sin(a), radius * Math.cos(a)];
}

function arc(from, to, radius) {
  const [x0, y0] = point(from, radius);
  const [x1, y1] = point(to, radius);
  return `M${x0} ${y0}A${radius} ${radius} 0 ${Math.abs(to - from) > 180 ? 1 : 0} ${to > from ? 0 : 1} ${x1} ${y1}`;
}

function mark(angle, radius, kind) {
  const made = drawing("path", { d: "M0 -7L7 7L-7 7Z", class: kind });
  const [x, y] = point(angle, radius);
  made.setAttribute("transform", `translate(${x} ${y}) rotate(${-angle})`);
  return made;
}

function needle(angle, inner, outer) {
  const [x0, y0] = point(angle, inner);
  const [x1, y1] = point(angle, outer);
  return drawing("line", { x1: x0, y1: y0, x2: x1, y2: y1, class: "needle" });
}

// The angle at the centre of `svg` from straight down to where an event points, positive to the right [deg].
function pointed(svg, event) {
  const place = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  return (Math.atan2(place.x, place.y) * 180) / Math.PI;
}

function draggable(svg, value, set, done) {
  let held = false;
  const move = (event) => held && set(value(pointed(svg, event)));
  svg.addEventListener("pointerdown", (event) => {
    if (!svg.classList.contains("live")) return;
    held = true;
    svg.setPointerCapture(event.pointerId);
    move(event);
  });
  svg.addEventListener("pointermove", move);
  svg.addEventListener("pointerup", () => {
    if (held) done();
    held = false;
  });
  svg.addEventListener("pointercancel", () => (held = false));
}

// A dial: a scale that is drawn once for each full scale, and above it what moves, drawn when it has changed.
class Dial {
  constructor(id) {
    this.svg = byId(id);
    this.rim = drawing("g");
    this.moving = drawing("g");
    this.svg.replaceChildren(this.rim, this.moving);
    this.wish = null; // what is asked "what if", or ordered while the mouse holds it
    this.last = {};
    this.max = null;
    this.shown = "";
  }

  // Draws `state` {value, order, max, live} by the dial's own `scale()` and `marks(state)`.
  draw(state) {
    this.last = state;
    if (!known(state.max)) return;
    if (state.max !== this.max) {
      this.max = state.max;
      this.rim.replaceChildren(...this.scale());
      this.svg.setAttribute("aria-valuemin", -this.max);
      this.svg.setAttribute("aria-valuemax", this.max);
    }
    const fine = (value) => (known(value) ? value.toFixed(1) : "");
    const shown = [fine(state.value), fine(state.order), fine(this.wish), state.live, state.max].join();
    if (shown === this.shown) return;
    this.shown = shown;
    this.svg.classList.toggle("live", state.live);
    this.svg.setAttribute("aria-valuenow", known(state.value) ? state.value.toFixed(0) : "0");
    this.moving.replaceChildren(...this.marks(state));
  }

  clamp(value) {
    return Math.max(-this.max, Math.min(this.max, value));
  }
}

// The rudder: a scale below the ship, port on the left. `onWish(degrees, final)` while it is dragged.
export class RudderDial extends Dial {
  constructor(onWish) {
    super("rudder");
    const set = (angle) => {
      this.wish = angle;
      this.draw(this.last);
      onWish(angle, false);
    };
    draggable(this.svg, (angle) => Math.round(this.clamp((angle / SPREAD) * this.max)), set, () => onWish(this.wish, true));
  }

  at(rudder) {
    return (this.clamp(rudder) / this.max) * SPREAD;
  }

  scale() {
    const parts = [drawing("path", { d: arc(-SPREAD, SPREAD, RADIUS), class: "rim" })];
    const most = 10 * Math.floor(this.max / 10);
    for (let degrees = -most; degrees <= most; degrees += 10) {
      const at = this.at(degrees);
      const [x0, y0] = point(at, RADIUS - 6);
      const [x1, y1] = point(at, RADIUS + 1);
      const [x, y] = point(at, RADIUS + 20);
      parts.push(drawing("line", { x1: x0, y1: y0, x2: x1, y2: y1, class: "tick" }));
      parts.push(drawing("text", { x, y: y + 4, class: "scale" }, Math.abs(degrees)));
    }
    return parts;
  }

  marks({ value, order }) {
    const parts = [];
    if (known(value)) {
      if (Math.abs(value) > 0.2) parts.push(drawing("path", { d: arc(0, this.at(value), RADIUS - 14), class: value < 0 ? "port" : "starboard" }));
      parts.push(needle(this.at(value), 34, RADIUS));
    }
    if (known(order)) parts.push(mark(this.at(order), RADIUS + 3, "order"));
    if (this.wish !== null) parts.push(mark(this.at(this.wish), RADIUS - 3, "wish"));
    parts.push(drawing("text", { x: 0, y: 8, class: "value" }, known(value) ? `${sided(value)}°` : "–"));
    if (known(order)) parts.push(drawing("text", { x: 0, y: 26, class: "scale" }, `order ${sided(order)}°`));
    return parts;
  }
}

// The engine: shaft revolutions per minute, ahead to the right over the top, astern to the left.
export class EngineDial extends Dial {
  constructor(onWish) {
    super("engine");
    const value = (angle) => Math.round(this.clamp(((angle < 0 ? -180 - angle : 180 - angle) / FULL) * this.max));
    const set = (rpm) => {
      this.wish = rpm;
      this.draw(this.last);
    };
    draggable(this.svg, value, set, () => {
      onWish(this.wish);
      this.wish = null;
    });
  }

  at(rpm) {
    return 180 - (this.clamp(rpm) / this.max) * FULL;
  }

  scale() {
    const parts = [drawing("path", { d: arc(180 + FULL, 180 - FULL, ROUND), class: "rim" })];
    for (const share of [-1, -0.5, 0, 0.5, 1]) {
      const [x0, y0] = point(this.at(share * this.max), ROUND - 6);
      const [x1, y1] = point(this.at(share * this.max), ROUND + 2);
      parts.push(drawing("line", { x1: x0, y1: y0, x2: x1, y2: y1, class: "tick" }));
    }
    parts.push(drawing("text", { x: 0, y: 26, class: "scale" }, "rpm"));
    parts.push(drawing("text", { x: -48, y: 62, class: "scale" }, "astern"));
    parts.push(drawing("text", { x: 48, y: 62, class: "scale" }, "ahead"));
    return parts;
  }

  marks({ value, order }) {
    const parts = [];
    if (known(value)) {
      if (Math.abs(value) > 1) parts.push(drawing("path", { d: arc(this.at(0), this.at(value), ROUND - 12), class: "ahead" }));
      parts.push(needle(this.at(value), 30, ROUND));
    }
    if (known(order)) parts.push(mark(this.at(order), ROUND + 3, "order"));
    if (this.wish !== null) parts.push(mark(this.at(this.wish), ROUND - 3, "wish"));
    parts.push(drawing("text", { x: 0, y: 8, class: "value" }, number(value)));
    return parts;
  }
}

let turned = "";

// Rate of turn [deg/min] as a bar from the middle, to the side she turns to; full scale 30, 60, 120 or 240.
export function drawTurn(rot) {
  const full = [30, 60, 120, 240].find((most) => !known(rot) || Math.abs(rot) <= most) ?? 240;
  const shown = known(rot) ? `${full} ${rot.toFixed(1)}` : "";
  if (shown === turned) return;
  turned = shown;
  const at = (value) => 120 + (Math.max(-full, Math.min(full, value)) / full) * 104;
  const parts = [drawing("line", { x1: at(-full), x2: at(full), y1: 16, y2: 16, class: "rim" })];
  for (const share of [-1, -0.5, 0, 0.5, 1]) {
    const x = at(share * full);
    parts.push(drawing("line", { x1: x, x2: x, y1: 9, y2: 23, class: "tick" }));
    parts.push(drawing("text", { x, y: 38, class: "scale" }, Math.abs(share * full)));
  }
  if (known(rot)) {
    if (Math.abs(rot) > 0.2) parts.push(drawing("line", { x1: at(0), x2: at(rot), y1: 16, y2: 16, class: rot < 0 ? "port" : "starboard" }));
    parts.push(drawing("line", { x1: at(rot), x2: at(rot), y1: 7, y2: 25, class: "needle" }));
  }
  byId("turn").replaceChildren(...parts);
}
