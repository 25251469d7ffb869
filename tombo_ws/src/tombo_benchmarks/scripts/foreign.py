"""Flights of other people's simulators, with a parameter changed on their side, diagnosed.

    python foreign.py FOLDER [--peer rotorpy] [--seed 0] [--only wind]

FOLDER keeps the peer's own virtual environment (made at the first run, some 100 MB from PyPI:
its numpy and scipy are others than ours), and for each case the flights' tables, the mapping, and
the answer. Only files pass between the two. What was changed and what `tombo diagnose` says of it
is printed side by side; what rotorpy's vehicle has in any case and no datasheet tells (rotor and
body drag, translational lift) is found in the healthy case, too.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from tombo_benchmarks.peers.peer_environments import make_environment

MAPPING = """\
about: rotorpy, recorded as a laboratory would
time: {column: t, unit: s}
channels:
  position: {columns: [x, y, z], unit: m, time: {column: seen, unit: s}}
  attitude: {columns: [qx, qy, qz, qw], order: xyzw, time: {column: seen, unit: s}}
  gyro: {columns: [wx, wy, wz], unit: rad/s}
  accel: {columns: [ax, ay, az], unit: m/s^2}
  rotor_speed: {columns: [n2, n4, n1, n3], unit: rad/s}
  rotor_command: {columns: [c2, c4, c1, c3], unit: rad/s}
airframe: {name: hummingbird, mass: 0.5, arm_length: 0.17, rotor_radius: 0.1,
           inertia: [0.00365, 0.00368, 0.00703], motor_time_constant: 0.005}
"""
CASES: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "healthy": ({}, ()),
    "wind": ({"wind": [1.5, 0.0]}, ("steady_wind",)),
    "body drag": ({"parameters": {"c_Dx": 5.0, "c_Dy": 5.0}}, ("quadratic_body_drag",)),
    "rotor drag": ({"parameters": {"k_d": 2.5}}, ("linear_rotor_drag",)),
    "lever arm": ({"imu": [0.03, -0.01, 0.02]}, ("imu_lever_arm",)),
    "marker": ({"marker": [0.02, 0.01, 0.0]}, ("mocap_marker_offset",)),
    "late stamps": ({"late": 0.02}, ("mocap_stamp_error",)),
    "slow motors": ({"parameters": {"tau_m": 6.0}}, ("motor_lag",)),
    "heavier": ({"parameters": {"mass": 1.1}}, ("mass_error",)),
    "less thrust": ({"parameters": {"k_eta": 0.9}}, ("thrust_coefficient_error",)),
}
"""Name → the order to the peer, and what it is called here."""


def say(text: str = "") -> None:
    """Write a line."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def ask(folder: Path, python: Path, peer: str, order: dict[str, Any]) -> dict[str, Any]:
    """Let the peer fly, and return what the diagnosis says."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "order.json").write_text(json.dumps(order | {"folder": str(folder)}))
    script = Path(__file__).parent / "peers" / f"{peer}_flights.py"
    subprocess.run([python, script, folder / "order.json"], check=True)
    (folder / "mapping.yaml").write_text(MAPPING)
    logs = sorted(str(path) for path in folder.glob("flight_*.csv"))
    tombo = Path(sys.executable).with_name("tombo")
    command = [tombo, "diagnose", *logs, "--mapping", folder / "mapping.yaml", "--json"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    (folder / "diagnosis.json").write_text(done.stdout)
    said: dict[str, Any] = json.loads(done.stdout)
    return said


def main() -> None:
    """Run all cases, or those asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--peer", choices=("rotorpy",), default="rotorpy")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=CASES, action="append")
    given = parser.parse_args()
    python = make_environment(given.folder.resolve(), given.peer, say)
    say(f"{'changed':14} {'verdict':18} {'stated':>6}  causes")
    for name, (order, truth) in CASES.items():
        if given.only and name not in given.only:
            continue
        folder = given.folder.resolve() / given.peer / name.replace(" ", "_")
        said = ask(folder, python, given.peer, order | {"seed": given.seed})
        causes = [cause["effect"] for cause in said["causes"]] + said["set"]
        found = ", ".join(f"[{c}]" if c in truth else c for c in dict.fromkeys(causes))
        say(f"{name:14} {said['verdict']:18} {said['confidence']:6.2f}  {found or '–'}")
    say("[..]: what was changed")


if __name__ == "__main__":
    main()
