"""Bad input: one line with the name, the value and the accepted values; exit 2; nothing
written."""

from __future__ import annotations

import io
import shlex
from pathlib import Path

import pytest

from tombo_flight.suite.nodes import SUITE

BAGS = Path(__file__).parents[5] / "tests" / "bags"
GEOMETRY = (
    "--set vehicle.arm_length=0.24 --set propeller.k_thrust=1.5e-5 "
    "--set propeller.k_torque=2.4e-7 --set propeller.radius=0.127"
)
VEHICLE = f"--set vehicle.mass=1.5 {GEOMETRY}"
REFUSED = [
    ("fly --set vehicle.mas=1", "mas", "did you mean 'mass'", "accepted"),
    ("fly --set vehicle.mass=-1", "vehicle.mass", "-1", "accepted", "0.01 to 10 [kg]"),
    ("fly --set vehicle.mass=nan", "vehicle.mass", "nan", "[kg]"),
    ("fly --set vehicle.mass", "vehicle.mass", "key=value"),
    ("fly --set 'vehicle.mass={a: b'", "vehicle.mass", "YAML"),
    ("fly --set reaction.name=jump", "reaction.name", "jump", "bounce"),
    ("fly --set effects.gust.deviation=1", "gust", "did you mean 'gusts'"),
    ("fly --set propeller.conf=2.5", "propeller.conf", "2.5", "whole number"),
    ("fly --set propeller.conf=1", "propeller.conf", "1.82 N", "vehicle.mass"),
    ("fly --seed -1", "--seed", "-1", "from 0"),
    ("fly --seed 1.5", "--seed", "1.5", "whole number"),
    ("fly --seed 999999999999999999999999999999", "--seed", "999999999999999999999999999999"),
    ("fly --seed 1 --seeds 0:2", "--seed: accepted: without --seeds"),
    ("fly --seeds 5:5", "--seeds", "5:5", "A < B"),
    ("fly --seeds 0:1000000", "--seeds", "0:1000000", "at most"),
    ("fly -o ''", "-o", "accepted"),
    ("fly a b", "b"),
    ("fly --reaction policy", "reaction.network", "accepted"),
    ("fly --import yours.py", "--import 'yours.py'", "no such file"),
    ("diagnose nowhere.mcap", "nowhere.mcap", "does not exist", "accepted"),
    ("diagnose empty.mcap", "empty.mcap"),
    ("diagnose noise.ulg", "noise.ulg"),
    ("diagnose a.mcap --map pose", "--map pose", "TOPIC:=NAME"),
    ("diagnose a.mcap --map /a=/b --map /a=/c", "/a", "twice"),
    ("diagnose a.mcap --model m.yaml --healthy b.mcap", "--model and --healthy"),
    ("diagnose --healthy a.mcap b.mcap", "LOG"),
    ("diagnose a.mcap -o empty.mcap", "empty.mcap", "it is a file"),
    ("diagnose --explain-mapping a.csv b.csv", "2 logs", "accepted: one"),
    ("diagnose --explain-mapping words.csv", "words.csv", "no column of numbers"),
    ("fly hover --speed 2", "--speed: accepted: with --nodes and without --px4 and --lockstep"),
    ("fly hover --domain 3", "--domain: accepted: with --nodes or --px4"),
    ("fly hover --nodes --seeds 0:3", "--nodes: accepted: without --seeds"),
    ("fly hover --nodes --speed -1", "speed -1: out of bounds"),
    ("fly hover --px4 --nodes", "--px4: accepted: without --nodes, --seeds and --no-record"),
    ("fly hover --px4 ''", "link '' is not the URL of a link"),
    ("fly hover --px4 /dev/ttyUSB0", "is not the URL of a link; accepted: udpin://HOST:PORT"),
    ("fly hover --px4 udpin://0.0.0.0:14540 --yes", "--bridge link.allow_remote=true"),
    ("fly hover --px4 serial:///dev/null:57600 --yes", "can't be opened (inappropriate ioctl"),
    ("fly hover --px4 --bridge 'px4_parameters=[EKF2_EV_CTLR=11]'", "did you mean 'EKF2_EV_CTRL'"),
    (
        "fly hover --px4 udpin://127.0.0.1:14540 --yes --bridge px4.axes_evidence=simulated",
        "accepted: without a URL",
    ),
    ("fly hover --yes", "--yes: accepted: with --px4"),
    ("fly hover --px4 udpin://192.168.1.20:14540 --yes", "not to this machine"),
    ("fly hover --px4 udpin://127.0.0.1:14540", "accepted: with --yes, or on a terminal"),
    ("fly hover --px4 --bridge link.key_file=/no/such", "can't be read (no such file"),
    ("up hover --px4 --without controller", "unknown node 'controller'"),
    ("up hover --px4 --vehicles 2", "--px4: accepted: without --vehicles"),
    ("up --without detect", "unknown node 'detect' (did you mean 'detector'?)"),
    (f"up --without {' --without '.join(SUITE)}", "no node is left to start"),
    ("up --domain 233", "domain 233: out of bounds; accepted: a whole number from 0 to 232"),
    ("up --duration nan", "--duration nan: out of bounds"),
    ("up -o full", "folder 'full': not empty; accepted: a folder, new or empty"),
    ("replay none.mcap", "none.mcap", "No such file", "accepted: an MCAP file"),
    ("replay strike.mcap --map /mocap/pose:=/pose", "unknown topic in --map", "accepted"),
    ("replay strike.mcap --node detect", "'detect'", "did you mean 'detector'"),
    ("replay strike.mcap --node mission", "nothing to replay", "no /odometry"),
    ("replay strike.mcap --shift-stamps inf", "--shift-stamps inf"),
    ("propeller diagnose absent.csv", "can't read"),
    ("propeller diagnose absent.csv --conf 99", "unknown configuration"),
    ("propeller diagnose a.csv --plain --conf 13", "--plain: accepted: without --conf and --law"),
    ("sweep hover vehicle.mass=1.1:1.7", "vehicle.mass", "no levels", "accepted"),
    ("sweep hover 'vehicle.mass=gauss(1.3,0.1)' --design lhs --samples 4", "gauss", "norm"),
    ("sweep hover vehicle.mass=1,-1", "vehicle.mass", "-1", "0.01"),
    ("sweep hover vehicle.mass=1:2 --design lhs", "--samples"),
    ("sweep hover --workers 0", "--workers"),
    ("sweep hover --workers 1 --scheduler tcp://127.0.0.1:1", "--workers", "--scheduler"),
    ("sweep hover --scheduler 127.0.0.1", "127.0.0.1", "accepted"),
    (f"vehicle new mine.txt {VEHICLE}", ".yaml"),
    (f"vehicle new mine.yaml {VEHICLE} --set propeller.conf=13", "k_thrust", "conf"),
    ("vehicle from-flights nothing.mcap -o v.yaml", "nothing.mcap"),
    ("vehicle from-flights nothing.mcap -o there.yaml", "another name, or --force"),
    ("vehicle from-flights nothing.mcap -o v.yaml --mass nan", "--mass"),
    ("vehicle from-flights nothing.mcap", "-o"),
    ("hil --port 0 --speed nan", "--speed nan"),
    ("hil --port x", "'x'; accepted: a whole number"),
    ("px4 --port 65000", "--port 65000"),
    ("px4 --key /no/such/key", "/no/such/key"),
    ("compare nothing.mcap whole.mcap", "can't read 'nothing.mcap'"),
    ("compare whole.mcap whole.mcap --topic /odometri", "did you mean '/odometry'?"),
]
"""A command, and words of its answer."""
REFUSED_LATER = [
    ("sweep hover -o file", "-o file", "can't be written"),
    ("sweep hover -o full", "-o full", "not empty", "accepted"),
    ("propeller desine", "desine", "design"),
    ("flie", "flie", "fly", "list"),
    ("propeller design --mass 1300", "--mass: 1300"),
    ("propeller design --mass 1.3 --frame 24", "--frame 24"),
    ("propeller design --mass 1.3 --library nowhere", "--library nowhere"),
    ("propeller design --mass 1 --max-noise low", "--max-noise", "'low'; accepted: a number"),
    ("propeller design", "--mass"),
    ("propeller --conf 14 --json", "unknown configuration 14", "accepted"),
    ("propeller --rpm 2000:1000:100 --json", "--rpm 2000:1000:100", "accepted"),
    ("propeller --conf 1 --rpm 9000 --json", "9000 rpm) is outside the validity", "accepted"),
]
"""Those that load a model first."""


@pytest.fixture
def input_files(tmp_path, monkeypatch):
    """Files and folders that commands are asked to read or to fill; nobody answers questions."""
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    for name in ("file", "full/notes.txt", "there.yaml", "text.mcap"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("mine")
    (tmp_path / "folder").mkdir()
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "words.csv").write_text("name,kind\nfoo,bar\n")
    for name in ("noise.csv", "noise.ulg"):
        (tmp_path / name).write_bytes(bytes(range(256)) * 4)
    for name, number in (("whole", 0), ("strike", 7)):
        (tmp_path / f"{name}.mcap").symlink_to(BAGS / f"paper_collision_{number}.mcap")


@pytest.mark.usefixtures("input_files")
@pytest.mark.parametrize("case", REFUSED, ids=lambda case: case[0])
def test_bad_input_is_one_line_and_nothing_is_written(refused, tmp_path, case):
    line, *words = case
    refused(tuple(shlex.split(line)), *words)
    assert (tmp_path / "there.yaml").read_text() == "mine"


@pytest.mark.slow
@pytest.mark.usefixtures("input_files")
@pytest.mark.parametrize(("line", "words"), [(line, words) for line, *words in REFUSED_LATER])
def test_bad_input_of_a_model_is_one_line(refused, line, words):
    refused(tuple(shlex.split(line)), *words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("vehicle: {mass: 1.2\neffects:", ("broken.yaml", "YAML", "line")),
        ("- a\n- b\n", ("broken.yaml", "['a', 'b']")),
        ("extends: broken.yaml\n", ("broken.yaml", "extends itself")),
        ("extends: hover\nvehicle: {mass: .nan}\n", ("vehicle.mass", "nan")),
        ("extends: hover\nunit: inch\n", ("unit", "accepted")),
        ("a: !!python/object/apply:os.system [true]", ("broken.yaml",)),
    ],
)
def test_scenario_files(refused, tmp_path, text, words):
    (tmp_path / "broken.yaml").write_text(text)
    refused(("fly", "broken.yaml"), *words)


def test_a_key_with_an_escape_code_cannot_reach_the_terminal(refused):
    refused(("fly", "--set", "\x1b[31mred=1"), r"\x1b[31mred")
