// What if: the rudder dragged, a plan of orders, the fan of all orders with clearances, and the order that clears a chosen point.

import { ahead, byId, distance, element, known, notice, refill, sided, touches, write } from "./format.js";
import { ask } from "./link.js";

const EVERY = 1000; // ms between two questions
const FAN = 5; // deg between the orders of the fan
const LISTED = 10; // deg between those of its orders that are listed
const NEXT = 30; // s from one order of the plan to one that is added

export class WhatIf {
  // `order(degrees)` gives the first order of the plan to a simulated ship.
  constructor(chart, rudder, order) {
    this.chart = chart;
    this.rudder = rudder;
    this.on = false;
    this.plan = []; // [seconds from now, degrees]
    this.place = null; // {lat, lon}
    this.picking = false;
    this.busy = false;
    this.again = false; // something else was asked while the answer was under way
    this.max = 35;
    this.horizon = 90;
    byId("plan-add").addEventListener("click", () => this.add());
    byId("plan-give").addEventListener("click", () => this.plan.length && order(this.plan[0][1]));
    byId("point").addEventListener("click", () => this.pick());
    byId("point-distance").addEventListener("change", () => this.ask());
    chart.map.on("click", (event) => {
      if (!this.picking) return;
      const [lon, lat] = ol.proj.toLonLat(event.coordinate);
      this.place = { lat, lon };
      this.pick(false);
      this.ask();
    });
    setInterval(() => this.on && !this.busy && this.ask(), EVERY);
  }

  toggle(on = !this.on) {
    this.on = on;
    byId("whatif").setAttribute("aria-pressed", on);
    byId("whatif-panel").hidden = !on;
    document.body.toggleAttribute("data-whatif", on);
    if (this.picking) this.pick(false);
    if (!on) {
      Object.assign(this, { plan: [], place: null });
      byId("point").setAttribute("aria-pressed", false);
      write("choice", "");
      this.chart.showFan(null, null, null);
    }
    this.drawPlan();
    this.ask();
  }

  // The rudder was dragged to `angle` [deg]: the first order of the plan.
  wish(angle) {
    this.plan = [[0, angle], ...this.plan.slice(1)];
    this.drawPlan();
    this.ask();
  }

  add() {
    const [time, angle] = this.plan.at(-1) ?? [-NEXT, 0];
    if (time + NEXT > this.horizon) return notice(`A plan ends at ${this.horizon} s`);
    this.plan.push([time + NEXT, this.plan.length ? -angle : (this.rudder.last.order ?? 0)]);
    this.drawPlan();
    this.ask();
  }

  pick(on = !this.picking) {
    if (on && this.place) {
      this.place = null; // a second press forgets the point
      write("choice", "");
      on = false;
      this.ask();
    }
    this.picking = on;
    byId("point").setAttribute("aria-pressed", on || this.place !== null);
    notice(on ? "Click the point to stay off" : "");
  }

  drawPlan() {
    byId("plan").replaceChildren(...this.plan.map((order, k) => this.planRow(order, k)));
    byId("plan-give").disabled = this.plan.length === 0;
    this.rudder.wish = this.plan.length ? this.plan[0][1] : null;
    this.rudder.draw(this.rudder.last);
  }

  planRow([time, angle], k) {
    const when = element("input", { type: "number", min: 0, max: this.horizon, step: 5, value: time, "aria-label": "seconds from now" });
    const much = element("input", { type: "number", min: 0, max: this.max, step: 1, value: Math.abs(angle), "aria-label": "rudder, degrees" });
    const port = angle < 0;
    const name = angle === 0 ? "amidships" : port ? "port" : "starboard";
    const side = element("button", { class: `to-${name}`, title: "To the other side" }, name);
    const drop = element("button", { title: "Leave this order out" }, "×");
    when.disabled = k === 0;
    when.addEventListener("change", () => this.set(k, Number(when.value), angle));
    much.addEventListener("change", () => this.set(k, time, port ? -Number(much.value) : Number(much.value)));
    side.addEventListener("click", () => this.set(k, time, -angle));
    drop.addEventListener("click", () => {
      this.plan.splice(k, 1);
      if (this.plan.length) this.plan[0][0] = 0;
      this.drawPlan();
      this.ask();
    });
    return element("div", { class: "row" }, "at", when, "s rudder", much, "°", side, drop);
  }

  set(k, time, angle) {
    this.plan[k] = [time, angle];
    this.plan.sort((a, b) => a[0] - b[0]);
    this.drawPlan();
    this.ask();
  }

  // One question at a time; what changed meanwhile is asked as soon as the answer is there.
  async ask() {
    if (!this.on) return;
    this.again = this.busy;
    if (this.busy) return;
    this.busy = true;
    const clear = this.place && { ...this.place, distance: Number(byId("point-distance").value) };
    const most = FAN * Math.floor(this.max / FAN);
    const fan = { from: -most, to: most, step: FAN };
    try {
      const answer = await ask("api/whatif", { plan: this.plan.length ? this.plan : null, fan, clear });
      if (this.on) this.draw(answer);
    } catch (error) {
      notice(`What if: ${error.message}`);
    } finally {
      this.busy = false;
    }
    if (this.again) this.ask();
  }

  draw(answer) {
    const chosen = answer.choice?.rudder ?? null;
    this.chart.showFan(answer, chosen, this.place);
    write("choice", answer.choice?.text ?? "");
    const near = (n) => [n ? distance(n.distance) : "–", n && known(n.time) ? ahead(n.time) : ""];
    const shown = answer.paths.filter((p) => p.plan !== null || p.rudder % LISTED === 0 || p.rudder === chosen);
    shown.sort((a, b) => (b.plan !== null) - (a.plan !== null) || a.rudder - b.rudder);
    const rows = shown.map((path) => ({
      name: path.plan ? "Plan" : sided(path.rudder),
      kind: path.plan ? "plan" : path.rudder === chosen ? "chosen" : "",
      touches: [path.shore, path.target].some(touches),
      title: path.target ? `nearest target: ${path.target.name ?? path.target.id}` : "",
      near: [near(path.shore), near(path.target), near(path.point)],
    }));
    const heads = ["Rudder", "shore", "target", "point"].map((name) => element("th", {}, name));
    refill(byId("fan"), rows, () => [element("tr", {}, ...heads), ...rows.map(fanRow)]);
  }
}

function fanRow({ name, kind, touches, title, near }) {
  const cells = near.map(([far, when]) => element("td", {}, far, " ", element("span", { class: "minor" }, when)));
  return element("tr", { class: touches ? `${kind} dangerous` : kind, title }, element("td", {}, name), ...cells);
}
