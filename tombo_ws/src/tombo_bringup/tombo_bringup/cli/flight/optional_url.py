"""An option whose value may be left out: `--px4`, `--px4 URL`, `--px4=URL`."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from tombo_bringup import PX4_OF_LAB
from tombo_bringup.cli.options import Rule, option, record

if TYPE_CHECKING:
    from tombo_flight.suite.px4_connection import Px4Connection

OPTION = "--px4"
SIMULATED = "sim"
"""Value of the option for a simulated PX4, with a lab file, too."""
_URL = re.compile(r"[A-Za-z][\w+.-]*://|/dev/|$")
PX4_RULES: tuple[Rule, ...] = (
    ("yes", ("px4",), ()),
    ("bridge", ("px4",), ()),
    ("model", (), ("px4 URL",)),
)
"""Rules of commands with this option; a model changes a simulated vehicle, not one at a URL."""


@record
class Px4Options:
    """A PX4 that flies, and how it is reached."""

    px4: str | None = option(
        "--px4 [URL]",
        "Fly with the nodes over MAVLink: a simulated PX4, or the one at URL (udpin://, "
        "udpout://, tcpout://, serial://), which may be a real vehicle.",
    )
    yes: bool = option("--yes", "With --px4 URL: arm without asking first.", False)
    bridge: list[str] | None = option(
        "--bridge KEY=VALUE",
        "With --px4: set a parameter of the bridge, as in link.allow_remote=true, "
        "px4.tracked_body=lab_1 or, of PX4 itself, px4_parameters=[EKF2_EV_CTRL=11]; "
        "px4_parameters=safe: those with which a loss ends on the ground. May be given many "
        "times.",
    )

    @property
    def url(self) -> str | None:
        """The URL that is given; None: PX4 is simulated, or does not fly."""
        return None if self.px4 in (SIMULATED, PX4_OF_LAB) else self.px4

    @property
    def values(self) -> dict[str, Any]:
        """Name → value of these options, and of the URL, as `check_options` takes them."""
        return {**vars(self), "px4 URL": self.url}

    def connection(self) -> Px4Connection | None:
        """Return the connection; None without PX4.

        Raises:
            InputError: the URL, or a setting of the bridge, can't be used.
        """
        from tombo_flight.suite.px4_connection import px4_connection

        return None if self.px4 is None else px4_connection(self.url, self.bridge or [])


def expand_url_option(words: list[str]) -> list[str]:
    """Return the arguments with a value for the option: `PX4_OF_LAB` where none is given.

    The word behind it is its value if it looks like a URL (`SCHEME://...`), a device or nothing
    at all; any other is not.
    """
    found: list[str] = []
    rest = list(words)
    while rest:
        word = rest.pop(0)
        if word == "--":
            return [*found, word, *rest]
        if word == OPTION:
            given = rest and _URL.match(rest[0])
            word = f"{OPTION}={rest.pop(0) if given else PX4_OF_LAB}"
        found.append(word)
    return found
