"""The five-state filter of paper 000 with its printed noise, corrected only where the equations are wrong (E46, E48), in a control loop."""

import numpy as np

Q = np.diag([1e-5, 1e-5])  # of speed and course rate, per step (section 4)
R = np.diag([0.1, 0.1])  # m2
ALPHA = 1e-5, 0.2  # 1/s
C = np.eye(5)[:2]


class PaperFilter:
    """Table 1 for `ships` at once: a filter (guidance.pilot.Tracker) without a gate, in steps of `h` [s].

    States (ships, 5): north, east [m], speed [m/s], course [rad], course rate [rad/s]. The mean goes by f_d, Euler's step of (11)-(15), and
    not by its Jacobian (E46); the course is never subtracted from a measured one, so nothing wraps. It begins at the first fix with
    P = I as printed, and with `speed` and `course` [rad], of which the paper says nothing (assumed: those of the ship; E66).
    """

    def __init__(self, h: float, speed: float, course: float, ships: int = 1):
        self.h, self.begin = h, (speed, course)
        self.x = np.full((ships, 5), np.nan)
        self.P = np.tile(np.eye(5), (ships, 1, 1))
        self.ready = np.zeros(ships, bool)

    def step(self, time: float | None, north: np.ndarray, east: np.ndarray) -> None:
        """Go on by h and take in a fix (ships,), which there must be at each step."""
        z = np.stack([north, east], axis=-1)
        if self.ready.all():
            self._predict()
        else:
            self.x[:] = [0.0, 0.0, *self.begin, 0.0]
            self.x[:, :2] = z
            self.ready[:] = True
        gain = self.P[:, :, :2] @ np.linalg.inv(self.P[:, :2, :2] + R)
        self.x = self.x + (gain @ (z - self.x[:, :2])[..., None])[..., 0]
        kept = np.eye(5) - gain @ C  # I_5 (E48)
        self.P = kept @ self.P @ kept.transpose(0, 2, 1) + gain @ R @ gain.transpose(0, 2, 1)

    def _predict(self) -> None:
        h, (_, _, U, chi, omega) = self.h, self.x.T
        c, s, (slow, straight) = np.cos(chi), np.sin(chi), ALPHA
        A = np.tile(np.eye(5), (len(U), 1, 1))
        A[:, 0, 2], A[:, 0, 3], A[:, 1, 2], A[:, 1, 3] = h * c, -h * U * s, h * s, h * U * c
        A[:, 2, 2], A[:, 3, 4], A[:, 4, 4] = 1 - h * slow, h, 1 - h * straight
        self.x = self.x + h * np.stack([U * c, U * s, -slow * U, omega, -straight * omega], axis=-1)
        self.P = A @ self.P @ A.transpose(0, 2, 1)
        self.P[:, 2, 2] += h * h * Q[0, 0]
        self.P[:, 4, 4] += h * h * Q[1, 1]

    @property
    def north(self) -> np.ndarray:
        """Northing [m] (ships,)."""
        return self.x[:, 0]

    @property
    def east(self) -> np.ndarray:
        """Easting [m]."""
        return self.x[:, 1]

    @property
    def speed(self) -> np.ndarray:
        """Speed over ground [m/s]."""
        return self.x[:, 2]

    @property
    def course(self) -> np.ndarray:
        """Course over ground [rad], continuous."""
        return self.x[:, 3]

    @property
    def course_rate(self) -> np.ndarray:
        """Its rate [rad/s]."""
        return self.x[:, 4]
