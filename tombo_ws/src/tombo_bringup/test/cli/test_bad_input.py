"""Bad input: one line with the name, the value and the accepted values; exit 2; nothing
written."""

from __future__ import annotations

import io
import shlex
from pathlib import Path

import pytest

from tombo import fly
from tombo_dynamics.errors import InputError
from tombo_flight.suite.nodes import SUITE

BAGS = Path(__file__).parents[5] / "tests" / "bags"
GEOMETRY = (
    "--set vehicle.arm_length=0.24 --set propeller.k_thrust=1.5e-5 "
    "--set propeller.k_torque=2.4e-7 --set propeller.radius=0.127"
)
VEHICLE = f"--set vehicle.mass=1.5 {GEOMETRY}"
REFUSED = [
    ("fly --set vehicle.mas=1", "mas", "did you mean 'mass'", "accepted"),
    ("fly --set weather=1", "weather", "accepted: ", "vehicle"),
    ("fly --set vehicle.mass=-1", "vehicle.mass", "-1", "accepted", "0.01 to 10 [kg]"),
    ("fly --set vehicle.mass=nan", "vehicle.mass", "nan", "[kg]"),
    ("fly --set vehicle.mass=1e400", "vehicle.mass", "inf", "accepted"),
    ("fly --set vehicle.mass=heavy", "vehicle.mass", "heavy", "[kg]"),
    ("fly --set vehicle.mass=", "vehicle.mass", "None", "[kg]"),
    ("fly --set vehicle.mass", "vehicle.mass", "key=value"),
    ("fly --set =3", "=3", "key=value"),
    ("fly --set vehicle=3", "vehicle", "3", "mapping"),
    ("fly --set 'vehicle.mass={a: b'", "vehicle.mass", "YAML"),
    ("fly --set duration=2001-13-45", "duration", "2001-13-45"),
    ("fly --set duration=0", "duration", "0.1 to 3600"),
    ("fly --set react=perhaps", "react", "perhaps", "true or false"),
    ("fly --set reaction.name=jump", "reaction.name", "jump", "bounce"),
    ("fly --set disturbances=some", "disturbances", "some", "true or false"),
    ("fly --set effects=3", "effects", "3", "mapping"),
    ("fly --set effects.gusts=3", "effects.gusts", "3", "mapping"),
    ("fly --set effects.gust.deviation=1", "gust", "did you mean 'gusts'"),
    ("fly --set effects.gusts.size=1", "gusts", "size", "accepted: deviation"),
    ("fly --set effects.gusts.deviation=99", "effects.gusts.deviation", "99", "0 to 5 [m/s]"),
    ("fly --set detector.trigger=luck", "detector.trigger", "luck", "region"),
    ("fly --set propeller.law=hooke", "propeller.law", "hooke", "repaired"),
    ("fly --set propeller.conf=14", "propeller.conf", "14", "0 to 13"),
    ("fly --set propeller.conf=2.5", "propeller.conf", "2.5", "whole number"),
    ("fly --conf 14", "--conf", "14", "0 (rigid) to 13"),
    ("fly --conf soft", "--conf", "soft", "whole number"),
    ("fly --conf 1", "propeller.conf", "1.82 N", "vehicle.mass"),
    ("fly --law hooke", "law", "hooke", "published"),
    ("fly --seed -1", "--seed", "-1", "from 0"),
    ("fly --seed 1.5", "--seed", "1.5", "whole number"),
    ("fly --seed 999999999999999999999999999999", "--seed", "999999999999999999999999999999"),
    ("fly --seed 1 --seeds 0:2", "--seed 1", "--seeds 0:2"),
    ("fly --seeds 5", "--seeds", "5", "A:B"),
    ("fly --seeds 5:5", "--seeds", "5:5", "A < B"),
    ("fly --seeds -3:4", "--seeds", "-3:4", "0 <= A"),
    ("fly --seeds 0:4:2", "--seeds", "0:4:2", "A:B"),
    ("fly --seeds ''", "--seeds", "A:B"),
    ("fly --seeds 0:1000000", "--seeds", "0:1000000", "at most"),
    ("fly -o ''", "-o", "accepted"),
    ("fly --fast", "--fast"),
    ("fly a b", "b"),
    ("fly --reaction policy", "reaction.network", "accepted"),
    ("sweep pole vehicle.mass=1.1,1.1 --seeds 0:1", "vehicle.mass", "1.1"),
    ("fly --import yours.py", "--import 'yours.py'", "no such file"),
    ("sweep pole vehicle.mass=1.1,1.2 --seeds 0:1 --scheduler 127.0.0.1", "127.0.0.1", "accepted"),
    ("diagnose nowhere.mcap", "nowhere.mcap", "does not exist", "accepted"),
    ("diagnose empty.mcap", "empty.mcap"),
    ("diagnose noise.csv", "noise.csv"),
    ("diagnose noise.ulg", "noise.ulg"),
    ("diagnose a.mcap --map pose", "--map pose", "TOPIC:=NAME"),
    ("diagnose a.mcap --map /a=/b --map /a=/c", "/a", "twice"),
    ("diagnose a.mcap --mapping no_such_mapping", "no_such_mapping"),
    ("diagnose a.mcap --model no_model.yaml", "no_model.yaml"),
    ("diagnose a.mcap --model m.yaml --healthy b.mcap", "--model and --healthy"),
    ("diagnose --healthy a.mcap b.mcap", "LOG"),
    ("diagnose a.mcap -o ''", "-o ''", "accepted"),
    ("diagnose a.mcap -o empty.mcap", "empty.mcap", "it is a file"),
    ("diagnose", "LOG"),
    ("diagnose --explain-mapping a.csv b.csv", "2 logs", "accepted: one"),
    ("diagnose --explain-mapping nowhere.csv", "nowhere.csv", "does not exist"),
    ("diagnose --explain-mapping words.csv", "words.csv", "no column of numbers"),
    ("diagnose --explain-mapping words.csv -o folder", "folder", "is a folder"),
    ("diagnose --explain-mapping words.csv -o ''", "-o ''"),
    ("fly hover --speed 2", "--speed 2: accepted: with --nodes only"),
    ("fly hover --domain 3", "--domain 3: accepted: with --nodes or --px4 only"),
    ("fly hover --nodes --seeds 0:3", "--nodes: accepted: without --seeds and --no-record"),
    ("fly hover --nodes --no-record", "--nodes: accepted: without --seeds and --no-record"),
    ("fly hover --nodes --speed -1", "speed -1: out of bounds"),
    ("fly hover --nodes --domain -1", "domain -1: out of bounds"),
    ("fly hover --px4 --nodes", "--px4: accepted: without --nodes, --seeds and --no-record"),
    ("fly hover --px4 --seeds 0:3", "--px4: accepted: without --nodes"),
    ("fly hover --px4 --no-record", "--px4: accepted: without --nodes"),
    ("fly hover --px4 --speed 0.5", "--speed 0.5: accepted: without --px4, which is in real"),
    ("fly hover --px4 ''", "link '' is no URL of a link"),
    ("fly hover --px4 /dev/ttyUSB0", "is no URL of a link; accepted: udpin://HOST:PORT"),
    ("fly hover --px4 udpin://0.0.0.0:14540 --yes", "--bridge link.allow_remote=true"),
    ("fly hover --px4 serial:///dev/null:57600 --yes", "can't be opened (inappropriate ioctl"),
    ("fly hover --px4 --bridge 'px4_parameters=[EKF2_EV_CTRL]'", "or NAME=VALUE as EKF2"),
    ("fly hover --px4 --bridge px4_parameters=3", "px4_parameters: 3 is no list"),
    ("fly hover --px4 --bridge 'px4_parameters=[EKF2_EV_CTLR=11]'", "did you mean 'EKF2_EV_CTRL'"),
    (
        "fly hover --px4 udpin://127.0.0.1:14540 --yes --bridge px4.axes_evidence=simulated",
        "accepted: without a URL",
    ),
    ("fly hover --yes", "--yes and --bridge: accepted: with --px4 only"),
    ("fly hover --bridge px4.stream_rate=50", "--yes and --bridge: accepted: with --px4 only"),
    ("fly hover --px4 nowhere:// --yes", "'nowhere://' is no URL of a link"),
    ("fly hover --px4 udpin://192.168.1.20:14540 --yes", "not to this machine"),
    ("fly hover --px4 udpin://127.0.0.1:14540", "accepted: with --yes, or on a terminal"),
    ("fly hover --px4 --bridge px4.stream_rat=50", "did you mean 'stream_rate'"),
    ("fly hover --px4 --bridge px4.stream_rate=0", "px4.stream_rate: 0 is out of bounds"),
    ("fly hover --px4 --bridge pix4.setpoint=rates", "unknown section of --bridge"),
    ("fly hover --px4 --bridge link.url=a", "accepted: the URL behind --px4"),
    ("fly hover --px4 --bridge link.allow_remote=1", "accepted: true or false"),
    ("fly hover --px4 --bridge link=3", "accepted: a parameter of link"),
    ("fly hover --px4 --bridge link.key_file=/no/such", "can't be read (no such file"),
    ("fly hover --px4 --bridge setpoint", "--bridge 'setpoint': expected key=value"),
    ("up hover --px4 --without controller", "unknown node 'controller'"),
    ("replay none.mcap", "none.mcap", "No such file", "accepted: an MCAP file"),
    ("replay folder", "'folder' holds no recording", "accepted"),
    ("replay strike.mcap --map pose", "--map pose", "TOPIC:=NAME"),
    ("replay strike.mcap --map /pose:=/mocap/pose", "'/pose'", "accepted: /collision_event"),
    ("replay strike.mcap --map /mocap/pose:=/pose", "unknown topic in --map", "accepted"),
    (
        "replay strike.mcap --map /mocap/pose:=/odometry --map /mocap/pose:=/mocap/pose",
        "given twice",
    ),
    (
        "replay strike.mcap --map /mocap/pose:=/odometry --map /collision_event:=/odometry",
        "two topics under one name",
    ),
    ("replay strike.mcap --node detect", "'detect'", "did you mean 'detector'"),
    ("replay strike.mcap --node mission", "nothing to replay", "no /odometry"),
    ("replay strike.mcap --set detector.treshold=5", "treshold", "did you mean 'threshold'"),
    ("replay strike.mcap --scenario mine.yaml", "mine.yaml", "does not exist"),
    ("replay strike.mcap --shift-stamps inf", "--shift-stamps inf"),
    ("replay strike.mcap -o strike.mcap", "it is a file"),
    ("propeller diagnose", "STAND.csv"),
    ("propeller diagnose absent.csv", "can't read"),
    ("propeller diagnose absent.csv --conf 99", "unknown configuration"),
    (
        "propeller diagnose a.csv --plain --law repaired",
        "--plain: accepted: without --conf and --law",
    ),
    ("propeller diagnose a.csv --plain --conf 13", "--plain: accepted: without --conf and --law"),
    ("propeller diagnose absent.csv --mapping /tmp", "is a folder"),
    ("propeller diagnose absent.csv --model /tmp", "can't be read: Is a directory; accepted"),
    ("propeller diagnose absent.csv --law newton", "law"),
    ("propeller diagnose absent.csv --model absent.yaml", "can't be read"),
    ("sweep hover vehicle.mass=1.1:1.7", "vehicle.mass", "no levels", "accepted"),
    ("sweep hover 'vehicle.mass=norm(1.3,0.1)'", "vehicle.mass", "no levels", "accepted"),
    ("sweep hover 'vehicle.mass=gauss(1.3,0.1)' --design lhs --samples 4", "gauss", "norm"),
    ("sweep hover 'vehicle.mass=norm(0,1)' --design lhs --samples 9", "vehicle.mass", "accepted"),
    ("sweep hover,pol", "pol", "accepted"),
    ("sweep hover reaction.name=bounce,nothing", "nothing", "reflex"),
    ("sweep pole reaction.name=policy:nofile.json", "nofile.json", "accepted"),
    ("sweep hover vehicle.mas=1:2:1", "did you mean 'mass'"),
    ("sweep hover vehicle.mass=1,-1", "vehicle.mass", "-1", "0.01"),
    ("sweep hover vehicle.mass=1:2 --design lhs", "--samples"),
    ("sweep hover vehicle.mass=1:2 --design grid", "--design", "sobol"),
    ("sweep hover --seeds 5:5", "--seeds", "accepted"),
    ("sweep hover --workers 0", "--workers"),
    ("sweep hover --workers 1 --scheduler tcp://127.0.0.1:1", "--workers", "--scheduler"),
    ("sweep hover --reaction bounze", "did you mean 'bounce'"),
    ("sweep hover -o ''", "-o", "accepted"),
    ("up --without detect", "unknown node 'detect' (did you mean 'detector'?)"),
    (f"up --without {' --without '.join(SUITE)}", "no node is left to start"),
    ("up --speed 0", "speed 0: out of bounds; accepted: a number from 0.01"),
    ("up --speed nan", "speed nan: out of bounds"),
    ("up --domain 233", "domain 233: out of bounds; accepted: a whole number from 0 to 232"),
    ("up --duration -1", "--duration -1: out of bounds; accepted: a number above 0"),
    ("up --duration nan", "--duration nan: out of bounds"),
    ("up -o full", "folder 'full': not empty; accepted: a folder, new or empty"),
    ("vehicle new mine.yaml --set vehicle.mass=1.5", "propeller", "missing"),
    ("vehicle new mine.yaml --set propeller.conf=13", "vehicle", "missing"),
    (f"vehicle new mine.txt {VEHICLE}", ".yaml"),
    (f"vehicle new mine.yaml {VEHICLE} --set propeller.conf=13", "k_thrust", "conf"),
    (f"vehicle new mine.yaml {VEHICLE} --set propeller=3", "propeller", "3", "mapping"),
    (f"vehicle new mine.yaml {VEHICLE} --set propeller.on_impact=melts", "on_impact", "melts"),
    (f"vehicle new mine.yaml --set vehicle.mass=nan {GEOMETRY}", "vehicle.mass", "nan"),
    (
        f"vehicle new mine.yaml --set vehicle.mass=9 {GEOMETRY} --set vehicle.rotor_speed_max=600",
        "k_thrust",
        "at most",
    ),
    ("vehicle from-flights nothing.mcap -o v.yaml", "nothing.mcap"),
    ("vehicle from-flights nothing.mcap -o v.txt", "a file that ends with .yaml"),
    ("vehicle from-flights nothing.mcap -o there.yaml", "another name, or --force"),
    ("vehicle from-flights nothing.mcap -o v.yaml --mass nan", "--mass"),
    ("vehicle from-flights nothing.mcap", "-o"),
    ("hil --port 0 --speed -1", "--speed -1"),
    ("hil --port 0 --speed nan", "--speed nan"),
    ("hil --port 0 --duration 0", "--duration 0"),
    ("hil --port 70000", "port 70000"),
    ("hil --port -1", "port -1"),
    ("hil --port x", "'x' is not a whole number"),
    ("hil --port 0 hovr", "did you mean 'hover'"),
    ("px4 --port 0", "--port 0"),
    ("px4 --port 65000", "--port 65000"),
    ("px4 --port abc", "not a whole number"),
    ("px4 --ground-port 70000", "--ground-port 70000"),
    ("px4 --duration -1", "--duration -1"),
    ("px4 no_such", "no_such"),
    ("px4 --set vehicle.mass=-1", "vehicle.mass"),
    ("px4 --key /no/such/key", "/no/such/key"),
    ("px4 --seed -1", "--seed -1"),
    ("compare nothing.mcap whole.mcap", "can't read 'nothing.mcap'"),
    ("compare text.mcap whole.mcap", "starts with bytes"),
    ("compare whole.mcap whole.mcap --topic /odometri", "did you mean '/odometry'?"),
    ("compare whole.mcap whole.mcap -o ''", "-o ''"),
]
"""A command, and words of its answer."""
REFUSED_LATER = [
    ("sweep hover -o file", "-o file", "can't be written"),
    ("sweep hover -o full", "-o full", "not empty", "accepted"),
    ("propeller --conf soft", "--conf", "soft"),
    ("propeller --rpm -5", "--rpm", "-5", "accepted"),
    ("propeller --rpm 17000 --conf 1", "1"),
    ("propeller desine", "desine", "design"),
    ("flie", "flie", "fly", "list"),
    ("list reaction", "did you mean 'reactions'", "accepted: effects, reactions, scenarios"),
    ("--loud", "--loud"),
    ("propeller design --mass nan", "--mass: nan"),
    ("propeller design --mass 1300", "--mass: 1300"),
    ("propeller design --mass 1.3 --frame 24", "--frame 24"),
    ("propeller design --mass 1.3 --law published", "six fibres"),
    ("propeller design --mass 1.3 --blade ten_inch", "unknown blade"),
    ("propeller design --mass 1.3 --library nowhere", "--library nowhere"),
    ("propeller design --mass 1.3 --flights -1", "--flights -1"),
    ("propeller design --mass 1.3 -o ' '", "-o ' '"),
    ("propeller design --mass 1 --max-noise low", "accepted: a number from 1 to 200 [dB]"),
    ("propeller design --mass 1 --flights few", "accepted: a whole number from 0 to 200"),
    ("propeller design", "--mass"),
    ("propeller --conf 14 --json", "unknown configuration 14", "accepted"),
    ("propeller --law fixed --json", "unknown law 'fixed'", "accepted"),
    ("propeller --rpm nan --json", "--rpm nan", "accepted"),
    ("propeller --rpm -100:2000:100 --json", "--rpm -100:2000:100", "accepted"),
    ("propeller --rpm 1000:20000:100 --json", "18000 rpm", "accepted"),
    ("propeller --rpm 2000:1000:100 --json", "--rpm 2000:1000:100", "accepted"),
    ("propeller --rpm 1000:2000:0 --json", "--rpm 1000:2000:0", "STEP above 0"),
    ("propeller --rpm 1:2:3:4 --json", "--rpm 1:2:3:4", "accepted"),
    ("propeller --rpm 0:18000:0.0001 --json", "100000", "accepted"),
    ("propeller --conf 1 --rpm 9000 --json", "9000 rpm) is outside the validity", "accepted"),
]
"""Those that load a model first."""


@pytest.fixture
def things(tmp_path, monkeypatch):
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


@pytest.mark.usefixtures("things")
@pytest.mark.parametrize("case", REFUSED, ids=lambda case: case[0])
def test_bad_input_is_one_line_and_nothing_is_written(refused, tmp_path, case):
    line, *words = case
    refused(tuple(shlex.split(line)), *words)
    assert (tmp_path / "there.yaml").read_text() == "mine"


@pytest.mark.slow
@pytest.mark.usefixtures("things")
@pytest.mark.parametrize(("line", "words"), [(line, words) for line, *words in REFUSED_LATER])
def test_bad_input_of_a_model_is_one_line(refused, line, words):
    refused(tuple(shlex.split(line)), *words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("vehicle: {mass: 1.2\neffects:", ("broken.yaml", "YAML", "line")),
        ("extends: hover\nvehicle: {mass", ("broken.yaml", "YAML")),
        ("", ("broken.yaml", "None")),
        ("- a\n- b\n", ("broken.yaml", "['a', 'b']")),
        ("extends: broken.yaml\n", ("broken.yaml", "extends itself")),
        ("extends: nowhere\n", ("nowhere",)),
        ("extends: hover\nvehicle: {mass: .nan}\n", ("vehicle.mass", "nan")),
        ("extends: hover\nunit: inch\n", ("unit", "accepted")),
        ("1: 2\n", ("1", "accepted")),
        ("&a [*a, *a]", ("broken.yaml",)),
        ("\t", ("broken.yaml",)),
        ("a: !!python/object/apply:os.system [true]", ("broken.yaml",)),
    ],
)
def test_scenario_files(refused, tmp_path, text, words):
    (tmp_path / "broken.yaml").write_text(text)
    refused(("fly", "broken.yaml"), *words)


def test_a_key_with_an_escape_code_cannot_reach_the_terminal(refused):
    refused(("fly", "--set", "\x1b[31mred=1"), r"\x1b[31mred")


@pytest.mark.parametrize("seed", [-1, 1.5, "3"])
def test_a_seed_from_python_is_checked(seed):
    with pytest.raises(InputError, match=r"seed.*accepted"):
        fly("hover", seed=seed)
