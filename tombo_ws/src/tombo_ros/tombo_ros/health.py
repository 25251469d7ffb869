"""The report of a node on `/diagnostics`: faults with their history, and figures."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from tombo_bag.topics import DIAGNOSTICS
from tombo_dynamics.core import CoreHealth
from tombo_ros.conversion import to_time
from tombo_ros.topic import TopicPublisher

OK, WARN, ERROR = 0, 1, 2
_LEVELS = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)
_HARDWARE = "tombo"
_SHOWN_NS = 1_500_000_000
"""How long an event is shown: longer than the period of the reports, so that one has its text."""


class Health(CoreHealth):
    """Faults and figures of one node. A change is sent at the next `send`, and wanted at once."""

    def __init__(self, node: Any) -> None:
        super().__init__()
        self._node = node
        self._name = node.get_name()
        self._output = TopicPublisher(node, DIAGNOSTICS)
        self._counts: dict[str, int] = {}
        """Fault -> how often it has begun."""
        self._seen_ns: dict[str, int] = {}
        self.urgent = False
        """A fault has begun or ended since the last `send`."""

    def fault(self, key: str, active: bool, text: str = "", level: int = WARN) -> None:
        """Set or clear a fault; logged at its begin and end, and counted.

        While it lasts, reports have the newest text and level.

        Args:
            key: name of the fault, as `mocap_silent`.
            active: it is there now.
            text: for a person.
            level: WARN or ERROR.
        """
        was_active = key in self.faults
        super().fault(key, active, text, level)
        if was_active == active:
            return
        self.urgent = True
        logger = self._node.get_logger()
        if active:
            self._counts[key] = self._counts.get(key, 0) + 1
            if level >= ERROR:
                logger.error(f"{key}: {text or key}")
            else:
                logger.warning(f"{key}: {text or key}")
        else:
            logger.info(f"{key}: over")

    def report_event(self, key: str, text: str, level: int = WARN) -> None:
        """Report an event without duration; it is shown for 1.5 s after the last time."""
        self._seen_ns[key] = time.time_ns()
        self.fault(key, True, text, level)

    def clear_expired(self, wall_ns: int) -> None:
        """End the events that were last seen more than 1.5 s ago."""
        for key, seen_ns in list(self._seen_ns.items()):
            if wall_ns - seen_ns > _SHOWN_NS:
                del self._seen_ns[key]
                self.fault(key, False)

    def value(self, key: str, value: Any) -> None:
        """Set a figure of the report."""
        self.values[key] = value

    def send(self, now_ns: int, loops: Mapping[str, Mapping[str, Any]]) -> None:
        """Publish the report.

        Args:
            now_ns: ROS time.
            loops: name of each loop -> its figures; each becomes a status of its own.
        """
        self.urgent = False
        level = max((level for _, level in self.faults.values()), default=OK)
        values, texts = dict(self.values), []
        for key, count in self._counts.items():
            active = key in self.faults
            values[f"fault.{key}"] = f"{'active' if active else 'over'}, {count} times"
            texts += [f"{key}: {self.faults[key][0]}"] if active else []
        text = "; ".join(texts) or "ok"
        report = DiagnosticArray()
        report.header.stamp = to_time(now_ns)
        report.status = [_status(self._name, level, text, values)]
        for loop, metrics in loops.items():
            report.status.append(_status(f"{self._name}: {loop}", OK, "", metrics))
        self._output.publish(report)


def _status(name: str, level: int, text: str, values: Mapping[str, Any]) -> DiagnosticStatus:
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticStatus(
        level=_LEVELS[level], name=name, message=text, hardware_id=_HARDWARE, values=pairs
    )
