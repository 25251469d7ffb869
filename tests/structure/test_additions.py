"""A core is added to a copy of the packages, as in CONTRIBUTING.md, and flown."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
SRC = ROOT / "tombo_ws" / "src"


class Edit(NamedTuple):
    """A new file, or `new` put before the text `before` of a file."""

    path: str
    new: str
    before: str = ""


CORE = '''
from tombo_dynamics.core import Compiled, Core, Output
from tombo_dynamics.jit import compiled
from tombo_dynamics.message_records import PoseRecord
from tombo_dynamics.messages import Pose
from tombo_dynamics.records import Record, field

class AltimeterMemory(Record):
    pose = field("", "the last one", kind=PoseRecord)
    due = field("1", "it is to be published", kind=bool)

@compiled(inline=False)
def take_pose(memory, pose, now_ns):
    memory.pose = pose
    memory.due = True

class AltimeterCore(Core):
    """Publishes each pose again."""

    name = "altimeter"
    inputs = ("/mocap/pose",)
    outputs = {"/altitude": Output(Pose, "pose", "due")}
    compiled = Compiled(("memory",), (), {"/mocap/pose": take_pose})
    period_ns = 10_000_000
    sections = {}

    @classmethod
    def make(cls, records):
        core = cls()
        core.memory = AltimeterMemory.new()
        return core
'''
STEP = """@compiled(counted=False)
def _step_altimeter(memory: Any, mail: Mail, tick: int, now: int) -> None:
    for row in range(mail.fresh[_POSE], mail.there[_POSE]):
        altimeter_core.take_pose(memory, mail.tables[_POSE][mail.i, row].message, now)
        publish(memory.pose, mail.tables[-1], mail, len(TABLES) - 1, tick)
        memory.due = False


"""
ALTIMETER = "from tombo_control.altimeter_core import AltimeterCore\n"
CALL = "        _step_altimeter(altimeter, mail, tick, now)\n"
WIRING = "tombo_sim/tombo_sim/wiring.py"
TICK = "tombo_sim/tombo_sim/flight_loop.py"
EDITS = (
    Edit("tombo_control/tombo_control/altimeter_core.py", CORE),
    Edit(WIRING, "    AltimeterCore,\n", ")\n"),
    Edit(WIRING, ALTIMETER, "from tombo_control.controller_core"),
    Edit(TICK, "from tombo_control import altimeter_core\n", "from tombo_control.mission"),
    Edit(TICK, STEP, "@compiled(inline=False, counted=False)\ndef publish("),
    Edit(TICK, CALL, "        _step_reaction(reaction,"),
    Edit(TICK, "    altimeter: Any,\n", "    stop: int,\n) -> bool:  # fmt: skip"),
    Edit(TICK, "        flights.memories[5][0][i],\n", "        stop,\n"),
)
USE = """
from tombo_flight.flight import fly_scenario
from tombo_flight.replay.compared import NODES
from tombo_flight.run_wiring import run_wiring
from tombo_flight.scenario import load_scenario
from tombo_flight.suite.nodes import SUITE

assert SUITE["altimeter"] == "tombo_flight.suite.core_node"
assert NODES["altimeter"].inputs == ("/mocap/pose",)
scenario, heard = load_scenario("hover", ["duration=0.1"]), []
run_wiring(scenario, 0, lambda name, message: heard.append((name, message)))
altitudes = [message.position.tolist() for name, message in heard if name == "/altitude"]
assert len(altitudes) > 2
flown = fly_scenario(scenario, 0)["/altitude"]
assert flown["position"].values.tolist() == altitudes
"""


@pytest.mark.slow
def test_a_core_is_added_and_the_tick_equals_the_reference(tmp_path):
    for package in SRC.iterdir():
        shutil.copytree(
            package,
            tmp_path / package.name,
            ignore=shutil.ignore_patterns("__pycache__", "test", "*.egg-info", "build"),
        )
    for path, new, before in EDITS:
        file = tmp_path / path
        text = file.read_text(encoding="utf-8") if file.exists() else ""
        assert before in text, path
        begin, end = text.split(before, 1) if before else (text, "")
        file.write_text(begin + new + before + end, encoding="utf-8")
    packages = [str(package) for package in tmp_path.glob("tombo_*")]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([*packages, os.environ.get("PYTHONPATH", "")]),
        "TOMBO_CACHE_DIR": str(tmp_path / "cache"),
        "NUMBA_DISABLE_JIT": "1",
    }
    done = subprocess.run(
        [sys.executable, "-c", USE], env=environment, capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
