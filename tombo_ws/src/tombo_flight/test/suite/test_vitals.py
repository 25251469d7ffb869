"""Reports of the nodes on /diagnostics, and their table."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from rich.console import Console

from tombo_bag.columnar_cdr import encode
from tombo_bag.formats.mcap_sink import Columns, McapSink
from tombo_bag.recording import Recording
from tombo_bag.topics import DIAGNOSTICS
from tombo_dynamics.messages import Phase
from tombo_flight.suite.node_diagnostics import NodeDiagnostics, figure, node_metrics
from tombo_flight.suite.status_table import SuiteState, status_line, status_object, status_table
from tombo_flight.suite.supervisor import ProcessExit

LOOP = {"rate_hz": "250.0", "jitter_p50_us": "2", "jitter_p99_us": "60.5", "missed": "3"}


def status(name: str, level: int = 0, message: str = "ok", **values: str) -> dict[str, object]:
    return {"name": name, "level": level, "message": message, "values": values}


def node_diagnostics() -> NodeDiagnostics:
    found = NodeDiagnostics()
    found.take(
        [
            status("controller", mode="hold", mocap_age_s="0.5"),
            {"name": "controller: rate loop", "level": 0, "message": "", "values": LOOP},
            {"name": "controller: attitude loop", "level": 0, "message": "", "values": LOOP},
        ],
        10.0,
    )
    found.take([status("estimator", 2, "imu_silent: no gyro", mocap_age_s="0.031")], 10.0)
    return found


def suite(now_s: float = 10.5) -> SuiteState:
    return SuiteState(
        ("controller", "estimator", "mission", "sim"),
        {"controller": 11, "estimator": 12, "mission": 13},
        {"sim": ProcessExit("sim", -9, ())},
        node_diagnostics(),
        now_s,
        61.0,
    )


def shown(of: SuiteState) -> str:
    console = Console(width=140, force_terminal=False)
    with console.capture() as capture:
        console.print(status_table(of))
    return capture.get()


def test_a_report_has_the_node_and_its_loops_apart():
    found = node_diagnostics().nodes["controller"]

    assert found.level == 0
    assert found.message == ""
    assert found.values == {"mode": "hold", "mocap_age_s": 0.5}
    assert list(found.loops) == ["rate loop", "attitude loop"]
    assert figure(found.loops["rate loop"], "jitter_p99_us") == 60.5
    assert found.loops["rate loop"]["missed"] == 3
    assert math.isnan(figure(found.loops["rate loop"], "nothing"))


def test_the_freshest_pose_counts_and_nobody_knowing_is_no_number():
    assert node_diagnostics().mocap_age_s == 0.031
    assert math.isnan(NodeDiagnostics().mocap_age_s)


def test_a_height_is_not_shown_as_present_once_poses_are_lost():
    flight = {"phase": Phase.HOVER, "height_m": 1.99}
    hovers = replace(suite(), flights={"": (flight, 0.0)})
    assert "hover at 1.99 m" in status_line(hovers)
    lost = status_line(replace(hovers, flights={"": (flight, 12.2)}))
    assert "no pose for 12 s, last at 1.99 m" in lost and "hover" not in lost


def test_a_fault_is_one_line_on_a_narrow_terminal():
    text = "imu_silent: no gyro sample for 1.2 s; the vehicle descends on the last attitude"
    found = node_diagnostics()
    found.take([status("estimator", 2, text[:60], mocap_age_s="0.031")], 10.0)
    console = Console(width=80, height=24, force_terminal=False)
    with console.capture() as capture:
        console.print(status_table(replace(suite(), node_diagnostics=found)))
    assert f"estimator: {text[:60]}" in capture.get()
    assert len(capture.get().splitlines()) < 24


def test_the_table_shows_every_loop_and_every_trouble():
    text = shown(suite())

    assert "61 s up, mocap: 31 ms old" in text
    known = replace(suite(), flights={"": ({"height_m": 1.234, "phase": 3}, 0.0)})
    assert "61 s up, approach at 1.23 m, mocap: 31 ms old" in shown(known)
    assert "; approach at 1.23 m; " in status_line(known)
    assert "no phase at" in shown(
        replace(known, flights={"": ({"height_m": 1.234, "phase": None}, 0.0)})
    )
    lines = {line.split()[0]: line for line in text.splitlines() if line.split()}
    assert "running" in lines["controller"] and "60 us" in lines["controller"]
    assert text.count("250.0 Hz") == 2
    assert "estimator: imu_silent: no gyro" in text
    assert "starting" in lines["mission"]
    assert "killed by SIGKILL" in lines["sim"]


def test_who_has_said_nothing_for_seconds_is_called_silent():
    assert suite(10.0 + 2.9).state("controller") == "running"
    assert suite(10.0 + 3.1).state("controller") == "silent"
    assert "silent" in shown(suite(14.0))


def test_the_line_and_the_object_say_the_same():
    line, found = status_line(suite()), status_object(suite())

    assert line == (
        "61 s: 3 of 4 nodes run, 6 missed; estimator: imu_silent: no gyro; mission starting; "
        "sim killed by SIGKILL"
    )
    assert found["nodes"]["sim"]["exit_code"] == -9
    assert found["nodes"]["sim"]["pid"] is None
    assert found["nodes"]["controller"]["loops"]["rate loop"]["rate_hz"] == 250.0


def test_the_loops_of_several_vehicles_are_named_by_vehicle(tmp_path):
    path = tmp_path / "a.mcap"
    with McapSink(path) as sink:
        for vehicle, missed in (("v2", 7), ("v1", 3)):
            channel = sink.add_channel(f"/{vehicle}{DIAGNOSTICS.name}", DIAGNOSTICS.typename)
            reports = [
                ("controller: rate loop", {"rate_hz": "1000.0", "runs": "9", "missed": missed}),
                ("sim: loop", {"rate_hz": "999.0", "runs": "9", "missed": "0"}),
                ("sim", {"latency_gyro_to_command_p50_us": missed * 100}),
            ]
            content = [
                {"name": name, "values": [{"key": k, "value": str(v)} for k, v in values.items()]}
                for name, values in reports
            ]
            message = encode(DIAGNOSTICS.typename, {"status": content})
            sink.write_columns(Columns(channel, np.arange(1), [message]))
    with Recording(path) as recording:
        metrics = node_metrics(recording)
    assert list(metrics["loops"]) == ["v1/sim", "v1/rate", "v2/sim", "v2/rate"]
    assert [metrics["loops"][f"{v}/rate"]["missed"] for v in ("v1", "v2")] == [3, 7]
    assert metrics["latency_gyro_to_command_us"]["p50"] == 300
