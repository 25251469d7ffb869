"""Additions of docs/architecture.md in several files, made in a copy of the packages.

All are made in one copy; one process without compiled code then uses each of them.
"""

from __future__ import annotations

import json
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


class Addition(NamedTuple):
    """Additions and their use: an expression with its value."""

    edits: tuple[Edit, ...]
    use: str
    expected: object


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
MESSAGES = "tombo_dynamics/tombo_dynamics/messages.py"
MESSAGE = """# A greeting.

uint8 KIND_LOUD=5    # for all to hear

std_msgs/Header header        # [s] stamp: time of the greeting; frame map (ENU)
geometry_msgs/Vector3 wave    # [m/s] of the hand in map
uint8 kind                    # [-] no frame; one of the KIND_ constants
string text                   # [-] no frame; in words
"""
GREETING = '''
@dataclass(frozen=True)
class Greeting:
    """A greeting."""

    frame: ClassVar[str] = FRAME_MAP
    stamp_ns: int = field(metadata={"unit": "ns"})
    wave: Array = field(metadata={"unit": "m/s", "length": 3})
    kind: int
    text: str


'''
TOPIC = """
GREETING = TopicSpec("/greeting", "tombo_msgs/msg/Greeting", STATE, 0.0, "for the test")
TOPICS[GREETING.name] = GREETING
"""
ALTIMETER = "from tombo_control.altimeter_core import AltimeterCore\n"
CALL = "        _step_altimeter(altimeter, mail, tick, now)\n"
WIRING = "tombo_sim/tombo_sim/wiring.py"
TICK = "tombo_sim/tombo_sim/flight_loop.py"
LOAD = "from_('tombo_flight.scenario').load_scenario"

ADDITIONS = {
    "a message or a topic": Addition(
        (
            Edit("tombo_msgs/msg/Greeting.msg", MESSAGE),
            Edit("tombo_msgs/CMakeLists.txt", "  msg/Greeting.msg\n", "  DEPENDENCIES"),
            Edit(MESSAGES, GREETING, "MESSAGES: tuple"),
            Edit(MESSAGES, "    Greeting,\n", "    AttitudeSetpoint,\n"),
            Edit("tombo_bag/tombo_bag/topics.py", TOPIC),
        ),
        "sent_and_recorded('/greeting', 'Greeting', 7, [1.0, 2.0, 3.0], 5, 'hello')",
        [[7, [1.0, 2.0, 3.0], 5, "hello"], {"stamp_ns": "ns", "wave": "m/s", "kind": "1"}],
    ),
    "a core": Addition(
        (
            Edit("tombo_control/tombo_control/altimeter_core.py", CORE),
            Edit(WIRING, "    AltimeterCore,\n", ")\n"),
            Edit(WIRING, ALTIMETER, "from tombo_control.controller_core"),
            Edit(TICK, "from tombo_control import altimeter_core\n", "from tombo_control.mission"),
            Edit(TICK, STEP, "@compiled(inline=False, counted=False)\ndef publish("),
            Edit(TICK, CALL, "        _step_reaction(reaction,"),
            Edit(TICK, "    altimeter: Any,\n", "    stop: int,\n) -> bool:  # fmt: skip"),
            Edit(TICK, "        flights.memories[5][0][i],\n", "        stop,\n"),
        ),
        "[from_('tombo_flight.suite.nodes').SUITE['altimeter'],"
        " from_('tombo_flight.replay.outputs').NODES['altimeter'].inputs,"
        f" heard_alike({LOAD}('hover', ['duration=0.1']), '/altitude')]",
        ["tombo_flight.suite.core_node", ["/mocap/pose"], True],
    ),
}

USE = """
import json, sys
import numpy as np
from importlib import import_module as from_
from pathlib import Path

def heard_alike(scenario, topic):
    heard = []
    from_("tombo_flight.run_wiring").run_wiring(
        scenario, 0, lambda name, message: heard.append(message) if name == topic else None)
    flown = from_("tombo_flight.flight").fly_scenario(scenario, 0)[topic]
    return len(heard) > 2 and flown["position"].values.tolist() == [
        message.position.tolist() for message in heard]

def sent_and_recorded(topic, name, *values):
    kind = getattr(from_("tombo_dynamics.messages"), name)
    codec = from_("tombo_bag.message_codec")
    spec = from_("tombo_bag.topics").TOPICS[topic]
    data = codec.MessageCodec(spec.typename).encode(kind(*values))
    mcap_sink = from_("tombo_bag.formats.mcap_sink")
    with mcap_sink.McapSink(Path("a.mcap")) as sink:
        channel = sink.add_channel(topic, spec.typename)
        sink.write_columns(mcap_sink.Columns(channel, np.array([1]), [data]))
    with from_("tombo_bag.recording").Recording("a.mcap") as recording:
        (read,) = codec.messages_of(spec.typename, recording.columns(topic))
    record = from_("tombo_dynamics.message_records").record_of(kind)
    plain = [getattr(value, "tolist", lambda: value)() for value in vars(read).values()]
    return [plain, {name: field.unit for name, field in record.fields.items()}]

found = {}
for name, use in json.load(sys.stdin).items():
    try:
        found[name] = eval(use)
    except Exception as error:
        found[name] = repr(error)
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def used(tmp_path_factory):
    folder = tmp_path_factory.mktemp("workspace")
    for package in SRC.iterdir():
        shutil.copytree(
            package,
            folder / package.name,
            ignore=shutil.ignore_patterns("__pycache__", "test", "*.egg-info", "build"),
        )
    for addition in ADDITIONS.values():
        for path, new, before in addition.edits:
            file = folder / path
            text = file.read_text(encoding="utf-8") if file.exists() else ""
            assert before in text, path
            begin, end = text.split(before, 1) if before else (text, "")
            file.write_text(begin + new + before + end, encoding="utf-8")
    share = folder / "prefix" / "share" / "tombo_msgs"
    share.mkdir(parents=True)
    (share / "msg").symlink_to(folder / "tombo_msgs" / "msg")
    packages = [str(package) for package in folder.glob("tombo_*")]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([*packages, os.environ.get("PYTHONPATH", "")]),
        "AMENT_PREFIX_PATH": str(folder / "prefix"),
        "TOMBO_CACHE_DIR": str(folder / "cache"),
        "NUMBA_DISABLE_JIT": "1",
    }
    done = subprocess.run(
        [sys.executable, "-c", USE],
        input=json.dumps({name: addition.use for name, addition in ADDITIONS.items()}),
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
@pytest.mark.parametrize("name", ADDITIONS)
def test_the_addition_is_picked_up(name, used):
    assert used[name] == ADDITIONS[name].expected
