"""What tests over DDS share: a domain of their own, a counterpart node, node processes.

Everything stays on this machine (localhost discovery) and ends with the test.
"""

from __future__ import annotations

import contextlib
import ctypes
import itertools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from in_time import NotInTime
from tombo_dynamics.time_base import SECOND_NS
from tombo_flight.suite.nodes import local_discovery

_FIRST_DOMAIN, _DOMAINS = 102, 130
"""102..231: above the usual, below the ports' end. Each worker of the tests has its share."""
_WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
_NUMBERS = itertools.count(os.getpid())
FAILED = pytest.StashKey[bool]()


def failed(item: pytest.Item) -> bool:
    """Return whether a test has failed; for fixtures that end it."""
    return bool(item.stash.get(FAILED, False))


@contextlib.contextmanager
def ros_domain() -> Iterator[int]:
    """Set a ROS_DOMAIN_ID that no other test has, here and for processes that are started."""
    share = _DOMAINS // _WORKERS
    number = _FIRST_DOMAIN + _WORKER * share + next(_NUMBERS) % share
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("ROS_DOMAIN_ID", str(number))
        for name, value in local_discovery(os.environ).items():
            environment.setenv(name, value)
        yield number


@pytest.fixture
def domain() -> Iterator[int]:
    """Set a ROS_DOMAIN_ID of the test's own."""
    with ros_domain() as number:
        yield number


def die_with_the_test() -> None:
    """Let the kernel kill the node should the test itself be killed (PR_SET_PDEATHSIG)."""
    ctypes.CDLL(None).prctl(1, signal.SIGKILL, 0, 0, 0)


class NodeProcess:
    """A node as its own process: its output, its end."""

    def __init__(self, module: str, arguments: Sequence[str], log: Path) -> None:
        self.module = module
        self.log = log
        self._file = log.open("wb")
        self.process = subprocess.Popen(
            [sys.executable, "-m", *module.split(), "--ros-args", *arguments],
            stdout=self._file,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=die_with_the_test,
        )

    @property
    def output(self) -> str:
        return self.log.read_text(errors="replace")

    def wait_for_words(self, words: str, patience_s: float = 60.0) -> None:
        """Wait until the node has said that."""
        end = time.monotonic() + patience_s
        while words not in self.output:
            assert time.monotonic() < end, f"{words!r} is not in {self.output!r}"
            time.sleep(0.01)

    def end(self, number: int = signal.SIGINT, patience_s: float = 30.0) -> int:
        """Send a signal and return the exit code; a node that stays is killed and -9 returned."""
        with contextlib.suppress(ProcessLookupError):
            self.process.send_signal(number)
        try:
            return self.process.wait(patience_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self._file.close()


@pytest.fixture
def start(domain: int, tmp_path: Path) -> Iterator[Callable[..., NodeProcess]]:
    """Start nodes: `start("tombo_sim.sim_node", "-p", "seed:=3")`; all end with the test."""
    running: list[NodeProcess] = []

    def launch(module: str, *arguments: str) -> NodeProcess:
        log = tmp_path / f"{module.split()[-1]}-{len(running)}.log".replace("/", "_")
        running.append(NodeProcess(module, arguments, log))
        return running[-1]

    yield launch
    for process in running:
        process.close()


class Counterpart:
    """The rest of the world, played by the test: publishes, listens, drives `/clock`."""

    def __init__(self) -> None:
        import rclpy

        from tombo_ros.topic import PolledSubscription

        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = rclpy.create_node("counterpart", context=self._context)
        self._make_input = PolledSubscription
        self._outputs: dict[str, Any] = {}
        self.inputs: dict[str, Any] = {}
        self.heard: dict[str, list[Any]] = {}
        self.now_ns = SECOND_NS

    def subscribe(self, *specs: Any) -> None:
        for spec in specs:
            self.inputs[spec.name] = self._make_input(self.node, spec, 5000)
            self.heard[spec.name] = []

    def publish(self, spec: Any, message: Any) -> None:
        self._publisher(spec).publish(message)

    def _publisher(self, spec: Any) -> Any:
        if spec.name not in self._outputs:
            from tombo_ros.topic import TopicPublisher

            self._outputs[spec.name] = TopicPublisher(self.node, spec)
        return self._outputs[spec.name]

    def meet(self, *specs: Any, others: int = 1, patience_s: float = 120.0) -> None:
        """Wait until each topic has a subscriber, or for one that is listened to a publisher."""
        end = time.monotonic() + patience_s
        for spec in specs:
            while True:
                if spec.name in self.inputs:
                    there = self.node.count_publishers(spec.name)
                else:
                    there = self._publisher(spec)._publisher.get_subscription_count()
                if there >= others:
                    break
                assert time.monotonic() < end, f"nobody at the other end of {spec.name}"
                time.sleep(0.02)

    def tick(self, by_ns: int) -> None:
        """Move `/clock` on."""
        from rosgraph_msgs.msg import Clock

        from tombo_bag.topics import CLOCK
        from tombo_ros.conversion import to_time

        self.now_ns += by_ns
        self.publish(CLOCK, Clock(clock=to_time(self.now_ns)))

    def hear(self) -> None:
        """Take what has arrived."""
        for name, found in self.inputs.items():
            self.heard[name] += [taken.message for taken in found.take()]

    def wait_for(
        self,
        spec: Any,
        condition: Callable[[Any], object] = lambda message: True,
        patience_s: float = 60.0,
        meanwhile: Callable[[], object] | None = None,
        since: int | None = None,
    ) -> Any:
        """Return the first message, from the `since`th or now on, that meets a condition.

        Raises:
            NotInTime: none has come.
        """
        end = time.monotonic() + patience_s
        seen = len(self.heard[spec.name]) if since is None else since
        while time.monotonic() < end:
            self.hear()
            for message in self.heard[spec.name][seen:]:
                if condition(message):
                    return message
            seen = len(self.heard[spec.name])
            if meanwhile is not None:
                meanwhile()
            time.sleep(0.002)
        raise NotInTime(f"no such message on {spec.name} within {patience_s} s")

    def wait_for_fault(self, node: str, key: str, text: str = "", **more: Any) -> str:
        """Return the first report of a node on `/diagnostics` with a fault and a text."""
        from tombo_bag.topics import DIAGNOSTICS

        def named(report: Any) -> list[str]:
            said = [s.message for s in report.status if s.name == node]
            return [message for message in said if f"{key}:" in message and text in message]

        return named(self.wait_for(DIAGNOSTICS, named, **more))[0]

    def close(self) -> None:
        import rclpy

        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture
def world(domain: int) -> Iterator[Counterpart]:
    """Give the counterpart of the nodes under test."""
    import_module("rclpy")
    counterpart = Counterpart()
    yield counterpart
    counterpart.close()


def vector(values: Any) -> Any:
    """Return three numbers as a geometry_msgs/Vector3."""
    from geometry_msgs.msg import Vector3

    return Vector3(x=float(values[0]), y=float(values[1]), z=float(values[2]))


def point(values: Any) -> Any:
    """Return three numbers as a geometry_msgs/Point."""
    from geometry_msgs.msg import Point

    return Point(x=float(values[0]), y=float(values[1]), z=float(values[2]))
