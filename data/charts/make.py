"""Make data/charts/sound.geojson: an invented sound for trying the bridge. No such place exists; it is no chart to sail by.

Run from the project folder: `python data/charts/make.py`. Coasts are drawn through a few corners (metres north and east of 69.65 N
18.96 E, where the scenarios of cargo90 start) and roughened with a fixed seed; depth contours keep a distance from them.
"""

import json
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry import LineString, Point, Polygon, mapping

LATITUDE, LONGITUDE = 69.65, 18.96
NORTH, EAST = 111_560.0, 111_560.0 * np.cos(np.radians(LATITUDE))  # m per degree, near enough for an invented place
MAINLAND = [
    (-1500, 520),
    (-600, 450),
    (-150, 400),
    (300, 470),
    (700, 640),
    (1150, 560),
    (1500, 420),
    (1950, 330),
    (2350, -150),
]
MAINLAND += [(2450, -900), (2200, -1500), (2300, -2300), (3300, -2300), (3300, 1700), (-1500, 1700)]
ISLAND = [
    (-1500, -650),
    (-700, -560),
    (-150, -640),
    (350, -780),
    (760, -900),
    (930, -1150),
    (880, -1700),
    (700, -2300),
    (-1500, -2300),
]
HOLM = [(1250, -40), (1330, 20), (1440, 10), (1480, -60), (1420, -120), (1310, -110)]
QUAY = [(560, 700), (560, 505), (800, 505), (800, 700)]


def coast(corners, step: float, rough: float, seed: int) -> Polygon:
    """A coast through `corners`, bent at every `step` [m] by about `rough` [m]."""
    ring = Polygon(corners).segmentize(step).exterior
    points = np.array(ring.coords)[:-1]
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((len(points), 2))
    kernel = np.array([0.25, 0.5, 0.25])
    smooth = np.column_stack([np.convolve(np.r_[n[-1], n, n[0]], kernel, "valid") for n in noise.T])
    inside = (np.abs(points) < 2250).all(axis=1) & (points[:, 1] < 1600)  # the frame of the picture stays straight
    return Polygon(points + rough * smooth * inside[:, None]).buffer(-6).buffer(12).buffer(-6).buffer(0)


def feature(shape, kind: str, **more) -> dict:
    """A feature in longitude and latitude."""
    placed = shapely.transform(
        shape, lambda p: np.round(np.column_stack([LONGITUDE + p[:, 1] / EAST, LATITUDE + p[:, 0] / NORTH]), 6)
    )
    return {"type": "Feature", "properties": {"kind": kind, **more}, "geometry": mapping(placed)}


def main() -> None:
    """Write the chart."""
    frame = shapely.box(-1500, -2300, 3300, 1700)
    quay = Polygon(QUAY)
    land = shapely.union_all([coast(MAINLAND, 60, 16, 1), coast(ISLAND, 60, 16, 2), coast(HOLM, 25, 6, 3), quay])
    features = []
    for depth, away in ((20, 110), (10, 55), (5, 25)):
        shoal = shapely.simplify(land.buffer(away).buffer(-12).buffer(12), 2).intersection(frame)
        features += [feature(part, "depth", depth=depth) for part in shapely.get_parts(shoal)]
    features += [feature(part, "land") for part in shapely.get_parts(shapely.simplify(land, 1).intersection(frame))]
    features += [
        feature(LineString([(565, 505), (795, 505)]), "berth", name="Quay"),
        feature(Point(1380, -160), "buoy"),
        feature(Point(820, -830), "buoy"),
        feature(Point(330, 300), "danger", name="Rock 3 m"),
        feature(Point(1370, -50), "text", name="Holm"),
        feature(Point(1600, 900), "text", name="Invented sound: not for navigation"),
    ]
    text = ",\n".join(json.dumps(f, separators=(",", ":")) for f in features)
    Path(__file__).with_name("sound.geojson").write_text(f'{{"type":"FeatureCollection","features":[\n{text}\n]}}\n')


if __name__ == "__main__":
    main()
