"""UTM by Kawase's series, third order in the third flattening n: an authority independent of pyproj.

K. Kawase, "A general formula for calculating meridian arc length and its application to coordinate conversion in the
Gauss-Kruger projection", Bulletin of the Geospatial Information Authority of Japan 59 (2011); as the thesis prints it in
3.1.2, with alpha_1 = n/2 - 2 n^2/3 + 5 n^3/16 in place of the printed 1/2 - ... (erratum E43). Northern hemisphere.
"""

import numpy as np

RADIUS, FLATTENING, SCALE, FALSE_EAST = 6378137.0, 1 / 298.257223563, 0.9996, 500000.0
N = FLATTENING / (2 - FLATTENING)
RECTIFYING = RADIUS / (1 + N) * (1 + N**2 / 4 + N**4 / 64)
ALPHA = (N / 2 - 2 * N**2 / 3 + 5 * N**3 / 16, 13 * N**2 / 48 - 3 * N**3 / 5, 61 * N**3 / 240)
PRINTED_ALPHA = (1 / 2 - 2 * N**2 / 3 + 5 * N**3 / 16, *ALPHA[1:])


def grid(latitude, longitude, zone, alpha=ALPHA):
    """Northing, easting [m] and convergence [rad] of a position [rad]."""
    east_of_middle = longitude - np.radians(6 * zone - 183)
    k = 2 * np.sqrt(N) / (1 + N)
    t = np.sinh(np.arctanh(np.sin(latitude)) - k * np.arctanh(k * np.sin(latitude)))
    xi, eta = np.arctan2(t, np.cos(east_of_middle)), np.arctanh(np.sin(east_of_middle) / np.sqrt(1 + t**2))
    north, east, sigma, tau = xi, eta, 1.0, 0.0
    for j, a in enumerate(alpha, 1):
        north = north + a * np.sin(2 * j * xi) * np.cosh(2 * j * eta)
        east = east + a * np.cos(2 * j * xi) * np.sinh(2 * j * eta)
        sigma = sigma + 2 * j * a * np.cos(2 * j * xi) * np.cosh(2 * j * eta)
        tau = tau + 2 * j * a * np.sin(2 * j * xi) * np.sinh(2 * j * eta)
    slope, root = t * np.tan(east_of_middle), np.sqrt(1 + t**2)
    convergence = np.arctan((tau * root + sigma * slope) / (sigma * root - tau * slope))
    return SCALE * RECTIFYING * north, FALSE_EAST + SCALE * RECTIFYING * east, convergence
