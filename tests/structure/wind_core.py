"""A sixth core for the tests: estimates the wind from the drag that the accelerometer shows.

Lift and weight have no part along the disc plane, so the specific force in it is drag over mass:
-d (v - w) / m, with the velocity v of the vehicle and w of the air. The core solves it for w.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tombo_dynamics.core import Compiled, Core, Output
from tombo_dynamics.jit import compiled
from tombo_dynamics.message_records import OdometryRecord
from tombo_dynamics.messages import Odometry
from tombo_dynamics.params import param
from tombo_dynamics.records import Record, field, parameter_record
from tombo_dynamics.rotation import rotated
from tombo_dynamics.vehicle import VehicleParams

PERIOD_NS = 20_000_000


@dataclass(frozen=True)
class WindParams:
    drag: float = param(
        0.3, "N s/m", (0.01, 3.0), "per speed in the disc plane", "linear_rotor_drag"
    )
    time: float = param(0.5, "s", (0.01, 60.0), "constant of the filter", "a gust")


class WindMemory(Record):
    known = field("1", "an estimate of the state has come", kind=bool)
    odometry = field("", "the last one", kind=OdometryRecord)
    wind = field("m/s", "of the air, map; level", 3)
    message = field("", "place, and velocity of the air, map", kind=OdometryRecord)
    due = field("1", "it is to be published", kind=bool)


@compiled(inline=False)
def take_odometry(memory, vehicle, params, odometry, now_ns):
    memory.known = True
    memory.odometry = odometry


@compiled(inline=False)
def take_imu(memory, vehicle, params, imu, now_ns):
    if not memory.known:
        return
    through = vehicle.mass / params.drag
    v, q = memory.odometry.velocity, memory.odometry.attitude
    x, y, _ = rotated(q, (v[0] + through * imu.accel[0], v[1] + through * imu.accel[1], v[2]))
    gain = 1.0 - math.exp(-1e-3 / params.time)
    memory.wind[0] += gain * (x - memory.wind[0])
    memory.wind[1] += gain * (y - memory.wind[1])


@compiled(inline=False)
def step(memory, vehicle, params, now_ns):
    if memory.known:
        memory.message.stamp_ns = now_ns
        memory.message.position = memory.odometry.position
        memory.message.attitude[3] = 1.0
        memory.message.velocity = memory.wind
        memory.due = True


class WindCore(Core):
    name = "wind"
    inputs = ("/odometry", "/imu/data_raw")
    outputs = {"/wind": Output(Odometry, "message", "due", every=20)}  # noqa: RUF012
    compiled = Compiled(
        ("memory",),
        ("vehicle", "params"),
        {"/odometry": take_odometry, "/imu/data_raw": take_imu},
        step,
    )
    period_ns = PERIOD_NS
    steps_on_messages = False
    sections = {"vehicle": VehicleParams, "wind": WindParams}  # noqa: RUF012

    @classmethod
    def make(cls, records):
        return cls(records["vehicle"], records["wind"])

    def __init__(self, vehicle, params):
        super().__init__()
        self.memory = WindMemory.new()
        self.vehicle, self.params = parameter_record(vehicle), parameter_record(params)
