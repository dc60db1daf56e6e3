// What of a situation message goes on which layer of the chart: features in the order in which they are drawn.

import { ahead, distance, known, sided, touches } from "./format.js";
import { at, away, feature, line, lines, onBoard, ring, rings } from "./geometry.js";

const { LineString, MultiPoint, Point } = ol.geom;
const SMALLEST = 23; // px, 6 mm: below, a ship is drawn as a symbol (MSC.191(79) 6.1.2)
const STATIONS = 60; // px of a ship whose antennas are shown
const NAMED = 12; // targets with a name beside them, the most dangerous first
const CPAS = 3; // targets with a line between the nearest places of both hulls
const MOVING = 0.2; // m/s: slower, a target has no predicted path to look at

// `scale` is metres on the ground to the pixel.
export function ofOwn({ own, forecast, horizon }, scale) {
  if (!known(own?.lat) || !known(own.heading)) return [];
  const middle = new Point(at([own.lon, own.lat]));
  const bow = own.length / 2;
  const reach = Math.max(3 * own.length, (own.sog ?? 0) * (forecast?.time.at(-1) ?? horizon ?? 0));
  const made = [feature(new LineString([at(onBoard(own, bow, 0)), at(onBoard(own, bow + reach, 0))]), "heading")];
  if (own.length / scale < SMALLEST) return [...made, feature(middle, "symbol")];
  made.push(feature(ring(own.outline.map(([x, y]) => onBoard(own, x, y))), "hull"));
  if (own.length / scale < STATIONS) return made;
  for (const used of [true, false]) {
    const stations = own.antennas.filter((antenna) => antenna.used === used).map(({ x, y }) => at(onBoard(own, x, y)));
    if (stations.length) made.push(feature(new MultiPoint(stations), used ? "antenna" : "antenna-silent"));
  }
  return made;
}

export function ofTrack({ own, track }) {
  if (!track) return [];
  const last = known(own?.lat) ? own : { lon: track.lon.at(-1), lat: track.lat.at(-1) };
  return [feature(line({ lon: [...track.lon, last.lon], lat: [...track.lat, last.lat] }), "track")];
}

export function ofSwept({ forecast }) {
  return forecast?.swept.length ? [feature(rings(forecast.swept), "swept")] : [];
}

export function ofRegion({ forecast }) {
  if (!forecast) return [];
  const ellipses = forecast.regions.filter(({ time }) => time % 30 === 0).map((mark) => mark.ring);
  const made = forecast.region_swept.length ? [feature(rings(forecast.region_swept), "region")] : [];
  return ellipses.length ? [...made, feature(rings(ellipses), "ellipse")] : made;
}

// Predicted path and predicted ship: every 10 s, those of whole half minutes bolder and with their time.
export function ofForecast({ forecast, own }) {
  if (!forecast) return [];
  const made = [feature(line(forecast), "path")];
  const major = forecast.outlines.filter(({ time }) => time % 30 === 0);
  const minor = forecast.outlines.filter(({ time }) => time % 30 !== 0);
  if (minor.length) made.push(feature(rings(minor.map((mark) => mark.ring)), "outline"));
  if (major.length) made.push(feature(rings(major.map((mark) => mark.ring)), "outline-major"));
  const beside = 0.5 * (own?.beam ?? 0) + 30;
  for (const { time } of major) {
    const k = forecast.time.findIndex((t) => t >= time);
    if (k < 0) continue;
    // On the outer side of the turn, where the swept area is wide and the arc is not.
    const side = (forecast.rot[k] ?? 0) > 0 ? -90 : 90;
    made.push(feature(new Point(at(away([forecast.lon[k], forecast.lat[k]], forecast.heading[k] + side, beside))), "mark", ahead(time)));
  }
  const near = forecast.clearance;
  if (touches(near) && known(near.lat)) made.push(feature(new Point(at([near.lon, near.lat])), "touch"));
  return made;
}

export function ofArc({ arc }) {
  if (!arc) return [];
  const outlines = arc.outlines.map((mark) => mark.ring);
  return [feature(line(arc), "arc"), ...(outlines.length ? [feature(rings(outlines), "arc-outline")] : [])];
}

// The pivot point now, and where it will be at whole half minutes; far from the ship it says nothing and is left out.
export function ofPivot({ own, forecast }) {
  if (!known(own?.lat)) return [];
  const made = [];
  if (known(own.pivot) && Math.abs(own.pivot) < own.length) made.push(feature(new Point(at(onBoard(own, own.pivot, 0))), "pivot"));
  if (!forecast) return made;
  const later = forecast.pivot.filter((place, k) => {
    const time = forecast.time[k];
    return place && time > 0 && time % 30 === 0 && ol.sphere.getDistance(place, [forecast.lon[k], forecast.lat[k]]) < own.length;
  });
  if (later.length) made.push(feature(new MultiPoint(later.map(at)), "pivot-later"));
  return made;
}

// The symbol of a target whose outline would be too small: a triangle that points where she heads (SN.1/Circ.243).
function triangle(target, scale) {
  const heading = target.heading ?? target.cog ?? 0;
  const corner = (bearing, pixels) => away([target.lon, target.lat], heading + bearing, pixels * scale);
  const [bow, right, left] = [corner(0, 13), corner(145, 10), corner(-145, 10)];
  return [bow, right, left, bow];
}

function ofKind(targets, kind, scale) {
  const hulls = [];
  const later = [];
  for (const target of targets) {
    const { outline, outlines } = target;
    const long = outline ? ol.sphere.getDistance(outline[0], outline[Math.floor(outline.length / 2)]) / scale : 0;
    if (long < SMALLEST) {
      hulls.push(triangle(target, scale));
      continue;
    }
    hulls.push(outline);
    later.push(...outlines.map((mark) => mark.ring));
  }
  const made = [];
  const paths = targets.filter((target) => target.path?.time.length > 1 && target.sog > MOVING).map((target) => target.path);
  if (paths.length) made.push(feature(lines(paths), `${kind}-path`));
  if (later.length) made.push(feature(rings(later), `${kind}-later`));
  if (hulls.length) made.push(feature(rings(hulls), `${kind}-hull`));
  return made;
}

export function ofTargets({ own, targets, limits }, scale) {
  const placed = (targets ?? []).filter((target) => known(target.lat));
  const dangerous = placed.filter((target) => target.dangerous);
  const made = ofKind(placed.filter((target) => !target.dangerous), "target", scale);
  made.push(...ofKind(dangerous, "danger", scale));
  if (own && limits) {
    const close = dangerous.filter((target) => target.cpa_own && target.cpa_target && target.cpa <= limits.cpa);
    for (const target of close.slice(0, CPAS)) {
      made.push(feature(new LineString([at(target.cpa_own), at(target.cpa_target)]), "cpa", `CPA ${distance(target.cpa)}`));
    }
  }
  for (const target of placed.slice(0, NAMED)) {
    made.push(feature(new Point(at([target.lon, target.lat])), target.dangerous ? "danger-name" : "target-name", target.name ?? target.id));
  }
  return made;
}

// The answer of /api/whatif; `chosen` is an order [deg] or null, `place` the point to clear or null.
export function ofFan(answer, chosen, place) {
  const made = [];
  for (const path of answer?.paths ?? []) {
    const planned = path.plan !== null;
    const bold = planned || path.rudder === chosen;
    const look = planned ? "plan" : bold ? "fan-chosen" : [path.shore, path.target].some(touches) ? "fan-touches" : "fan";
    if (planned && path.swept.length) made.push(feature(rings(path.swept), "plan-area"));
    made.push(feature(line(path), look));
    if (bold && path.outlines.length) made.push(feature(rings(path.outlines.map((mark) => mark.ring)), "plan-outline"));
    const end = away([path.lon.at(-1), path.lat.at(-1)], path.heading.at(-1), bold ? 70 : 25);
    const words = planned ? "plan" : sided(path.rudder).replace(" ", "");
    made.push(feature(new Point(at(end)), bold ? "plan-name" : `${look}-name`, words));
  }
  if (place) made.push(feature(new Point(at([place.lon, place.lat])), "spot"));
  return made;
}
