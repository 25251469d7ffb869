"""Parameters of the motion capture: which system, which body, how its axes and stamps are read."""

from __future__ import annotations

from dataclasses import dataclass

from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.params import param, plain, validate

ROS = "ros"
SYSTEMS = {
    "optitrack": "Motive, over NatNet",
    "vicon": "Vicon Tracker or Nexus, over the DataStream SDK",
    "qualisys": "Qualisys Track Manager, over its real-time protocol",
    "vrpn": "a VRPN server",
    "mock": "poses that stand still, for trials without cameras",
    ROS: "a topic of another driver",
}
"""Name of a system, as in the wheel of libmotioncapture → its software; others by VRPN or ROS."""
UP_AXES = ("z_up", "y_up")
NOSE_AXES = ("+x", "+y", "-x", "-y")
"""With signs: YAML takes a bare y for true."""


@dataclass(frozen=True)
class MocapParams:
    """Where poses come from, and how they become poses of base_link in map."""

    system: str = plain("", f"source of the poses: {', '.join(SYSTEMS)}")
    host: str = plain("", "address of the motion-capture computer; of vrpn HOST:PORT")
    options: str = plain("", "KEY=VALUE of libmotioncapture, with spaces between them")
    topic: str = plain("", "of system ros: the driver's topic")
    body: str = plain("", "name of the rigid body; empty: the only one there is")
    bodies: str = plain(
        "", "names of several vehicles' rigid bodies, with spaces: the first is that of v1"
    )
    up: str = plain(
        "z_up", "axis of the system, and of its rigid bodies, that points up: z_up or y_up"
    )
    nose: str = plain(
        "+x", "axis of the rigid body that points to the nose, with z up: +x, +y, -x or -y"
    )
    delay: float = param(
        0.0,
        "s",
        (0.0, 0.2),
        "from capture to arrival of a pose; a topic has stamps of its own, made earlier by this",
        "0, because it differs: 5 to 10 ms is usual; `tombo check mocap` tells",
    )

    @property
    def tracked(self) -> dict[str, str]:
        """Topic's namespace, empty or as /v1 → name of the rigid body."""
        names = self.bodies.split()
        return {f"/v{k}": name for k, name in enumerate(names, 1)} or {"": self.body}

    def check(self) -> None:
        """Refuse unusable parameters.

        Raises:
            InputError: the message has the parameter, its value and the accepted ones.
        """
        validate(self, "mocap")
        for name, accepted in (("system", SYSTEMS), ("up", UP_AXES), ("nose", NOSE_AXES)):
            if getattr(self, name) not in accepted:
                raise unknown_name(f"mocap.{name}", getattr(self, name), accepted)
        if self.body and self.bodies:
            raise InputError(
                f"mocap.body '{self.body}' and mocap.bodies '{self.bodies}'; accepted: one of them"
            )
        if self.system == ROS and not self.topic:
            raise InputError("mocap.topic: ''; accepted with system ros: the driver's topic")
        if self.system not in (ROS, "mock") and not self.host:
            raise InputError(
                f"mocap.host: ''; accepted with system {self.system}: the address of the "
                "motion-capture computer"
            )
