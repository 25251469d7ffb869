"""The core of wind_core.py in plain Python."""

from __future__ import annotations

import math

import numpy as np
from wind_core import WindCore

from tombo_dynamics.core import Output
from tombo_dynamics.messages import Odometry
from tombo_dynamics.rotation import rotated


class WindInPython(WindCore):
    """Estimates the wind in Python."""

    name = "wind"
    outputs = {"/wind": Output(Odometry, every=20)}  # noqa: RUF012
    compiled = None

    def __init__(self, vehicle, params):
        super().__init__(vehicle, params)
        self.odometry = None
        self.wind = [0.0, 0.0]
        self.gain = 1.0 - math.exp(-1e-3 / params.time)
        self.through = vehicle.mass / params.drag

    def on(self, topic, message, now_ns):
        if topic == "/odometry":
            self.odometry = message
        elif self.odometry is not None:
            v, a = self.odometry.velocity, message.accel
            x, y = v[0] + self.through * a[0], v[1] + self.through * a[1]
            found = rotated(self.odometry.attitude, (x, y, v[2]))[:2]
            self.wind = [w + self.gain * (f - w) for w, f in zip(self.wind, found, strict=True)]

    def step(self, now_ns):
        if self.odometry is None:
            return []
        level, still = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)
        wind = np.array([*self.wind, 0.0])
        return [("/wind", Odometry(now_ns, self.odometry.position, level, wind, still))]
