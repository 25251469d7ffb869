"""Errors of the instruments: tachometer, load cells, camera."""

from __future__ import annotations

from tombo_dynamics.propeller.effects.registry import Param, StandRun, StandStage, stand_effect

_N, _NM = (-20.0, 20.0), (-2.0, 2.0)


@stand_effect(
    "rpm_scale",
    StandStage.SPEED,
    [Param("error", "1", 0.0, (-0.5, 1.0), "shown over true speed, less 1", 0.04)],
    signature="thrust and torque are off by twice the share, at every speed",
    separates_from={"air_density": "a second tachometer"},
)
def rpm_scale(m: StandRun, error: float) -> None:
    """Let the tachometer show a share too much: wrong pole count, slipping marker, clock."""
    m.speed /= 1.0 + error


@stand_effect(
    "speed_noise",
    StandStage.SPEED,
    [Param("deviation", "1", 0.0, (0.0, 0.2), "standard deviation over speed", 0.015)],
    signature="readings scatter more the faster it turns, thrust and torque together",
    separates_from={"fabrication_scatter": "the same propeller again"},
    stochastic=True,
)
def speed_noise(m: StandRun, deviation: float) -> None:
    """Let the shown speed of each point differ from the true one by chance."""
    m.speed *= 1.0 + deviation * m.point_draws


@stand_effect(
    "thrust_tare",
    StandStage.READING,
    [Param("offset", "N", 0.0, _N, "reading without load", 0.05, "thrust")],
    signature="the same error at every speed, also at standstill",
    separates_from={"thrust_gain": "two speeds far apart", "thrust_drift": "standstill again"},
)
def thrust_tare(m: StandRun, offset: float) -> None:
    """Shift the thrust's zero."""
    m.thrust += offset


@stand_effect(
    "thrust_gain",
    StandStage.READING,
    [Param("error", "1", 0.0, (-0.6, 1.5), "shown over true, less 1", 0.08)],
    signature="thrust is off by a share at every speed, known weights too",
    separates_from={"thrust_coefficient": "hang a known weight on the cell"},
)
def thrust_gain(m: StandRun, error: float) -> None:
    """Let the thrust cell show a share too much."""
    m.thrust *= 1.0 + error


@stand_effect(
    "thrust_drift",
    StandStage.READING,
    [Param("change", "N", 0.0, _N, "of the tare over a run", 0.06, "thrust")],
    signature="thrust on the way down differs from that on the way up, in steady growth",
    separates_from={"thrust_tare": "readings at standstill before and after"},
)
def thrust_drift(m: StandRun, change: float) -> None:
    """Let the thrust's zero wander steadily, as with temperature."""
    m.thrust += change * m.elapsed


@stand_effect(
    "torque_tare",
    StandStage.READING,
    [Param("offset", "N m", 0.0, _NM, "reading without load", 2e-3, "torque")],
    signature="the same error of torque at every speed, also at standstill",
    separates_from={"torque_gain": "two speeds far apart"},
)
def torque_tare(m: StandRun, offset: float) -> None:
    """Shift the torque's zero."""
    m.torque += offset


@stand_effect(
    "torque_gain",
    StandStage.READING,
    [Param("error", "1", 0.0, (-0.6, 1.5), "shown over true, less 1", 0.10)],
    signature="torque is off by a share at every speed, known torques too",
    separates_from={"drag_coefficient": "apply a known torque with arm and weight"},
)
def torque_gain(m: StandRun, error: float) -> None:
    """Let the torque cell show a share too much."""
    m.torque *= 1.0 + error


@stand_effect(
    "torque_drift",
    StandStage.READING,
    [Param("change", "N m", 0.0, _NM, "of the tare over a run", 2.5e-3, "torque")],
    signature="torque on the way down differs from that on the way up, in steady growth",
    separates_from={"torque_tare": "readings at standstill before and after"},
)
def torque_drift(m: StandRun, change: float) -> None:
    """Let the torque's zero wander steadily."""
    m.torque += change * m.elapsed


@stand_effect(
    "angle_offset",
    StandStage.READING,
    [Param("offset", "rad", 0.0, (-0.5, 0.5), "shown less true flap angle", 0.03)],
    signature="the flap angle is off by the same at every speed",
    separates_from={"load_sharing": "the flap angle at two speeds"},
    models=("tombo",),
)
def angle_offset(m: StandRun, offset: float) -> None:
    """Shift the zero of the measured flap angle."""
    m.beta += offset


@stand_effect(
    "tare_scatter",
    StandStage.READING,
    [
        Param("thrust", "N", 0.0, (0.0, 5.0), "standard deviation", 0.04, "thrust"),
        Param("torque", "N m", 0.0, (0.0, 0.5), "standard deviation", 1.5e-3, "torque"),
    ],
    signature="each run has an error of its own, the same at all of its speeds",
    separates_from={"fabrication_scatter": "the same propeller mounted again"},
    stochastic=True,
)
def tare_scatter(m: StandRun, thrust: float, torque: float) -> None:
    """Tare each run a little differently."""
    m.thrust += thrust * m.run_draws[:, 0]
    m.torque += torque * m.run_draws[:, 1]
