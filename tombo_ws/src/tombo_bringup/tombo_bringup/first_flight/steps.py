"""The steps of a first flight, each one record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tombo_bringup.first_flight import checks
from tombo_bringup.first_flight.checks import Outcome, Session


@dataclass(frozen=True)
class Step:
    """A step: a question that a person answers with yes, a check of the machine, or both.

    Attributes:
        key: its name.
        question: for the person; empty: none.
        does: of the machine; empty: nothing.
        mend: the remedy when it fails.
        check: of the machine, after the answer.
        again: its result may change with time; the step is repeated when a list is continued.
    """

    key: str
    question: str
    does: str
    mend: str
    check: Callable[[Session], Outcome] | None = None
    again: bool = False


STEPS = (
    Step(
        "lab", "", "`tombo lab check`: vehicle, volume, motion capture, link, parameters",
        "write what is missing into the lab file", checks.check_lab,
    ),
    Step(
        "mocap", "Carry the vehicle about, and let it lie still for two seconds: ready?",
        "`tombo check mocap`: ten mistakes of the motion capture",
        "start `tombo mocap --lab FILE`; each mistake names its mend", checks.check_mocap, True,
    ),
    Step(
        "clocks", "", "stamps against their arrival, and chrony where it is installed",
        "let chrony set the clocks of both computers", checks.check_clocks, True,
    ),
    Step(
        "parameters", "", "PX4's parameters against the file of `tombo px4 --write-params`",
        "load the file of `tombo px4 --write-params` in QGroundControl, and restart PX4",
        checks.check_parameters,
    ),
    Step(
        "battery", "", "charge, and PX4's limits of it",
        "charge the battery; set BAT_LOW_THR, BAT_CRIT_THR, BAT_EMERGEN_THR and COM_LOW_BAT_ACT",
        checks.check_battery, True,
    ),
    Step(
        "kill_switch", "Is the remote control on, and its kill switch off?",
        "PX4 reports the switch: on, then off",
        "map a switch to RC_MAP_KILL_SW, bind the remote control", checks.check_kill_switch, True,
    ),
    Step(
        "geofence", "", "PX4's geofence against the volume of the lab",
        "set GF_ACTION, GF_MAX_HOR_DIST and GF_MAX_VER_DIST", checks.check_geofence,
    ),
    Step(
        "rotors", "Are all propellers off?", "turns single motors for 2 s; you say which",
        "exchange the motors' signals, or two of three wires of a motor; propellers off",
        checks.check_rotors,
    ),
    Step(
        "axes", "Are the propellers off? The bridge will ask you to turn the vehicle by hand about"
        " each axis, to carry it along each axis, and to put it down: ready?",
        "the bridge proves the axes of the poses; nothing arms",
        "each finding names its mend (docs/px4.md)", checks.check_axes,
    ),
    Step(
        "propellers", "Are the propellers on, is nobody within reach, is the net closed, and has"
        " the pilot the kill switch in hand?", "", "do not fly before it is so", None, True,
    ),
    Step(
        "hover", "Fly: 0.5 m high, then land?", "flies `hover`, lands, disarms",
        "read the report of the flight (docs/px4.md)", checks.check_hover,
    ),
    Step(
        "kill", "Fly again: 0.3 m high, and the pilot switches the rotors off there?",
        "flies, and sees the rotors stop", "try the kill switch again on the ground",
        checks.check_kill,
    ),
    Step(
        "diagnosis", "", "`tombo diagnose` of the hover", "read its report before the next flight",
        checks.check_diagnosis,
    ),
    Step(
        "obstacle", "Is the report of the diagnosis understood, is the obstacle soft, the approach"
        " at 0.3 m/s, the reaction `bounce`?", "", "fly more hovers before the obstacle",
    ),
)  # fmt: skip
"""Steps in order; an obstacle comes last."""


def printed_steps() -> list[list[str]]:
    """Return the rows of the table for print: key, question, check, mend."""
    return [[f"`{s.key}`", s.question or "–", s.does or "–", s.mend] for s in STEPS]
