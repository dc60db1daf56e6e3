// Strip charts: surge, sway at bow and stern, rate of turn. What was with its band (two standard deviations), then what is predicted.

import { byId, colour, element, KNOT, knots, known, sided } from "./format.js";

const PAST = 180; // s
const AHEAD = 90;
const EVERY = 0.5; // s, the least between two rows: more than a strip of 300 px can show
const GAP = 5; // s: after a longer one the past is taken from the message again
const TITLE = 22; // px of the words above each strip
const AXIS = 22; // px of the axis of time below the last
const LOWEST = 46; // px of a strip that can still be read
const STRIPS = [
  { title: "Surge", unit: "kn", scale: 1 / KNOT, keys: ["surge"], least: 0.5 },
  { title: "Sway bow, stern", unit: "kn", scale: 1 / KNOT, keys: ["sway_bow", "sway_stern"], least: 0.5 },
  { title: "Rate of turn", unit: "°/min", scale: 1, keys: ["rot"], least: 2 },
];
const KEYS = STRIPS.flatMap((strip) => strip.keys);

// Series of a strip: for each key the value, the two edges of its band, and what is predicted.
function seriesOf(strip) {
  const edge = { stroke: "transparent", points: { show: false }, width: 0 };
  const of = (stroke) => [{ stroke, width: 2, points: { show: false } }, edge, edge, { stroke, width: 2, dash: [5, 4], points: { show: false } }];
  return [{}, ...strip.keys.flatMap((_, k) => of(colour(k ? "second" : "ours")))];
}

function bandsOf(strip) {
  return strip.keys.map((_, k) => ({ series: [4 * k + 2, 4 * k + 3], fill: colour(k ? "second-band" : "band") }));
}

function now(u) {
  const x = u.valToPos(0, "x", true);
  u.ctx.fillStyle = colour("quiet");
  u.ctx.fillRect(Math.round(x), u.bbox.top, 1, u.bbox.height);
}

export class Strips {
  constructor() {
    this.past = []; // rows {time, KEY: [value, sd]}
    this.build();
    new ResizeObserver(() => this.resize()).observe(byId("strips"));
  }

  // Colours are read once, so a new palette needs new charts.
  build() {
    this.charts?.forEach(({ plot }) => plot.destroy());
    this.drawn = null; // the time of the last row that was drawn
    const place = byId("strips");
    place.replaceChildren();
    this.charts = STRIPS.map((strip, number) => this.chart(strip, place, number === STRIPS.length - 1));
    this.resize();
  }

  chart(strip, place, last) {
    const values = element("b");
    const under = element("div");
    place.append(element("div", { class: "title" }, strip.title, values), under);
    const grid = { stroke: colour("grid"), width: 1 };
    const axis = { stroke: colour("quiet"), grid, ticks: { show: false }, font: "13px DejaVu Sans, sans-serif" };
    const seconds = (_, at) => at.map((s) => (s === 0 ? "now" : `${s} s`));
    const made = { strip, values, last, range: [-1, 1] };
    const options = {
      width: 300,
      height: LOWEST,
      cursor: { show: false },
      legend: { show: false },
      padding: [4, 8, last ? 0 : 4, 0],
      series: seriesOf(strip),
      bands: bandsOf(strip),
      scales: { x: { time: false, range: [-PAST, AHEAD] }, y: { range: () => made.range } },
      axes: [
        { ...axis, size: last ? AXIS : 0, splits: () => [-180, -120, -60, 0, 60], values: last ? seconds : () => [] },
        { ...axis, size: 44, space: 17 },
      ],
      hooks: { draw: [now] },
    };
    made.plot = new uPlot(options, [[0], ...Array(strip.keys.length * 4).fill([null])], under);
    return made;
  }

  // The strips share what the lists above and below leave.
  resize() {
    const { clientWidth: width, clientHeight: whole } = byId("strips");
    if (!width) return;
    const height = Math.max(LOWEST, Math.floor((whole - AXIS) / STRIPS.length) - TITLE);
    this.charts.forEach(({ plot, last }) => plot.setSize({ width, height: height + (last ? AXIS : 0) }));
  }

  update({ time, own, track, forecast }) {
    if (!own || !known(time)) return;
    const last = this.past.at(-1)?.time;
    if (last === undefined || time < last || time > last + GAP) this.refill(track);
    this.keep(time, (key) => [own[key], own.sds[key]]);
    if (byId("strips").clientWidth === 0 || this.drawn === this.past.at(-1).time) return;
    this.drawn = this.past.at(-1).time;
    const rows = this.past;
    const later = forecast ? forecast.time.map((t) => t + forecast.start - time) : [];
    const x = [...rows.map((row) => row.time - time), ...later];
    for (const chart of this.charts) this.drawStrip(chart, x, rows, forecast, own);
  }

  drawStrip(chart, x, rows, forecast, own) {
    const { strip, plot, values } = chart;
    const data = [x];
    const shown = []; // what the scale must hold: the values, and the band of the newest
    const blank = { past: rows.map(() => null), later: forecast ? forecast.time.map(() => null) : [] };
    for (const key of strip.keys) {
      const of = (f) => [...rows.map((row) => (known(row[key][0]) ? f(...row[key]) * strip.scale : null)), ...blank.later];
      const [middle, high, low] = [of((v) => v), of((v, s) => v + 2 * (s ?? 0)), of((v, s) => v - 2 * (s ?? 0))];
      const predicted = forecast ? forecast[key].map((v) => (known(v) ? v * strip.scale : null)) : [];
      data.push(middle, high, low, [...blank.past, ...predicted]);
      shown.push(...middle, ...predicted, high[rows.length - 1], low[rows.length - 1]);
    }
    const held = shown.filter(known);
    const [low, high] = held.length ? [Math.min(...held), Math.max(...held)] : [0, 0];
    const room = Math.max((high - low) * 0.1, strip.least); // so that a quiet ship gives a quiet line
    chart.range = [low - room, high + room];
    plot.setData(data);
    const texts = strip.keys.map((key) => {
      if (key === "rot") return sided(own.rot, 1);
      return key === "surge" ? knots(own.surge) : sided(known(own[key]) ? own[key] / KNOT : null, 1);
    });
    const spans = texts.map((text, k) => element("span", { class: k ? "second" : "first" }, text));
    values.replaceChildren(...spans, ` ${strip.unit}`);
  }

  refill(track) {
    this.past = [];
    track?.time.forEach((t, k) => this.keep(t, (key) => [track[key][k], track.sds[key][k]]));
  }

  keep(time, value) {
    const last = this.past.at(-1);
    if (last && time < last.time + EVERY) return;
    const row = { time };
    for (const key of KEYS) row[key] = value(key);
    this.past.push(row);
    while (this.past[0].time < time - PAST) this.past.shift();
  }
}
