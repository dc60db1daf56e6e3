// Places and shapes: longitude and latitude [deg] of the messages to the chart's plane (Mercator on the sphere, EPSG:3857).

const { Feature } = ol;
const { LineString, MultiLineString, MultiPolygon, Polygon } = ol.geom;
const RAD = Math.PI / 180;
const PLANE = 6378137; // m, the sphere of EPSG:3857
const RADIUS = 6371008.8; // m, the mean sphere that lengths are measured on

// Called for some thousand places with each message, so without the library's general way from one projection to another.
export const at = ([lon, lat]) => [PLANE * lon * RAD, PLANE * Math.log(Math.tan(Math.PI / 4 + (lat * RAD) / 2))];
const points = (path) => path.lon.map((lon, k) => at([lon, path.lat[k]]));
export const line = (path) => new LineString(points(path));
export const lines = (paths) => new MultiLineString(paths.map(points));
export const ring = (places) => new Polygon([places.map(at)]);
export const rings = (list) => new MultiPolygon(list.map((one) => [one.map(at)]));
export const feature = (geometry, look, text = undefined) => new Feature({ geometry, look, text });

// The place `metres` away from [lon, lat] on `bearing` [deg], near enough on a sphere for a ship's length.
export function away([lon, lat], bearing, metres) {
  const north = (metres * Math.cos(bearing * RAD)) / RADIUS;
  const east = (metres * Math.sin(bearing * RAD)) / (RADIUS * Math.cos(lat * RAD));
  return [lon + east / RAD, lat + north / RAD];
}

// The place of a point `x` forward and `y` to starboard [m] of midship.
export function onBoard(own, x, y) {
  return away([own.lon, own.lat], own.heading + Math.atan2(y, x) / RAD, Math.hypot(x, y));
}

// Metres on the ground of a pixel at latitude `lat` [deg], where the plane has `resolution` metres to the pixel.
export const metres = (resolution, lat) => resolution * Math.cos(lat * RAD);

// Distance [m] and bearing [deg] from one place to another.
export function rangeAndBearing(from, to) {
  const [lon0, lat0, lon1, lat1] = [...from, ...to].map((v) => v * RAD);
  const y = Math.sin(lon1 - lon0) * Math.cos(lat1);
  const x = Math.cos(lat0) * Math.sin(lat1) - Math.sin(lat0) * Math.cos(lat1) * Math.cos(lon1 - lon0);
  return { range: ol.sphere.getDistance(from, to), bearing: Math.atan2(y, x) / RAD };
}
