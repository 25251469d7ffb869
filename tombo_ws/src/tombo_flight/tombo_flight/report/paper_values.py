"""The paper's collision experiment in figures, to be held against a flight.

Source: "Tombo Propeller: Bio-Inspired Deformable Structure toward Collision-Accommodated
Control for Drones", the flight experiment with Conf. 13 propellers. The paper's frame is NED;
points here are ENU: (x, y, z) = (east, north, up).
"""

from __future__ import annotations

import math

COLLISION_TIME_S = 23.0
"""About; read from the paper's recovery figure."""

UNSTABLE_PHASE_S = 1.5
RECOVERY_PHASE_S = 3.5
MEAN_RECOVERY_TIME_S = 5.0
MEAN_MAX_FALLING_DISTANCE_M = 0.5
OBSERVED_FALLING_RATE_M_S = 0.3

COLLISION_POINT_M = (1.7, 0.0, 2.0)
"""x_c, printed as NED [0, 1.7, -2.0]: where the vehicle's centre is at contact."""

BOUNCE_DISTANCE_M = 0.8
"""d_r, the distance from x_c to x_r that the reaction asks for."""

EQUILIBRIUM_POINT_M = (0.9, 0.2, 2.0)
"""x_r, printed as NED [0.2, 0.9, -2.0]."""

PRINTED_BOUNCE_M = math.dist(COLLISION_POINT_M, EQUILIBRIUM_POINT_M)
"""0.825 m: the printed points are not exactly d_r apart, x_r was chosen by hand."""
