"""`tombo hil`: its output, refused input, and its end."""

from __future__ import annotations

import re
import shlex
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

COMPOSE = Path(__file__).parents[4] / "docker" / "compose.yaml"
PEER = Path(__file__).parents[4] / "tombo_ws/src/tombo_px4/test/autopilot" / "hil_peer.py"
COMMAND = [sys.executable, "-m", "tombo_bringup.cli.main", "hil", "--port", "0"]


class Started:
    """The command as a process, with PX4 stand-ins."""

    def __init__(self) -> None:
        self.processes: list[subprocess.Popen[str]] = []
        self.port = 0
        self.lines: list[str] = []

    def hil(self, *options: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [*COMMAND, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.processes.append(process)
        self.read(process, "waiting for PX4 on TCP port")
        found = re.search(r"port (\d+)", self.lines[-1])
        assert found
        self.port = int(found[1])
        return process

    def read(self, process: subprocess.Popen[str], until: str) -> None:
        """Lines up to one that has `until` in it."""
        assert process.stdout is not None
        for line in process.stdout:
            self.lines.append(line.rstrip("\n"))
            if until in line:
                return
        raise AssertionError(f"'{until}' never came: {self.lines}")

    def stop(self, process: subprocess.Popen[str]) -> tuple[int, str]:
        """Ctrl-C: its exit code, and its stderr; `lines` are complete then."""
        process.send_signal(signal.SIGINT)
        assert process.stdout is not None
        assert process.stderr is not None
        self.lines += [line.rstrip("\n") for line in process.stdout]
        return process.wait(timeout=60), process.stderr.read()

    def px4(self, seconds: float) -> None:
        self.processes.append(
            subprocess.Popen([sys.executable, str(PEER), str(self.port), str(seconds)], text=True)
        )


@pytest.fixture
def started() -> Iterator[Started]:
    made = Started()
    yield made
    for process in made.processes:
        process.kill()
        process.communicate(timeout=60)


@pytest.mark.slow
def test_px4_flies_and_ctrl_c_ends_it_with_0(started):
    process = started.hil("--speed", "0")
    started.px4(60.0)
    started.read(process, "in lockstep from now")
    started.read(process, "armed")
    assert started.stop(process) == (0, "")
    assert started.lines[-1].startswith("stopped after 1 flights")
    assert any("PX4 has connected: flight 1 begins" in line for line in started.lines)


def test_a_busy_port_is_one_line_and_2(refused):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        taken = f"Error: link 'tcpin://127.0.0.1:{port}': can't be opened (address already in"
        refused(("hil", "--port", str(port)), taken)


@pytest.fixture
def introduction(tombo) -> Callable[..., str]:
    """Output of the command before PX4 connects."""

    def told(*options: str) -> str:
        result = tombo("hil", "--port", "0", "--duration", "0.05", *options)
        assert result.code == 0
        return result.out

    return told


def settings(text: str) -> list[dict[str, str]]:
    """The environments that the printed commands make: of the vehicle, of motion capture."""
    blocks = [block.split("\n./build")[0] for block in text.split("export ")[1:]]
    words = [shlex.split(block.replace("\\\n", " ").split("\n")[0]) for block in blocks]
    return [dict(word.split("=") for word in found) for found in words]


def test_it_prints_how_px4_is_started_for_this_vehicle(introduction):
    text = introduction()
    given, _ = settings(text)
    assert given["PX4_SIM_MODEL"] == "none_iris"
    assert given["PX4_SYS_AUTOSTART"] == "10016"
    assert float(given["PX4_PARAM_MPC_THR_HOVER"]) == pytest.approx(0.46, abs=0.001)
    front_right = [given[f"PX4_PARAM_CA_ROTOR0_{name}"] for name in ("PX", "PY", "KM")]
    assert [float(v) for v in front_right] == pytest.approx([0.17, 0.17, 0.04])
    front_left = [given[f"PX4_PARAM_CA_ROTOR2_{name}"] for name in ("PX", "PY", "KM")]
    assert [float(v) for v in front_left] == pytest.approx([0.17, -0.17, -0.04])
    assert "PX4_PARAM_EKF2_EV_CTRL" not in given
    assert "./build/px4_sitl_default/bin/px4\n" in text
    assert "parameters*.bson" in text  # PX4 falls back on parameters_backup.bson
    assert "PX4_PARAM_IMU_INTEG_RATE" not in given


def test_the_compose_services_have_the_printed_parameters(introduction):
    services = yaml.safe_load(COMPOSE.read_text(encoding="utf-8"))["services"]
    px4 = services["px4"]
    text = introduction()
    vehicle, mocap = settings(text)
    assert px4["environment"] == vehicle | mocap
    assert px4["command"] == ["-d"]  # its shell takes a core without a terminal
