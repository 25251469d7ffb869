"""A ROS_DOMAIN_ID for one flight, so that two of them on one machine do not meet."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

HIGHEST_DOMAIN = 232
"""Above it the ports do not fit (DDSI-RTPS 9.6.1.1)."""
HIGHEST_PRIVATE = 101
"""Above it the ports reach into the range that Linux gives away by itself."""
_FIRST_PORT = 7400
_PORTS = 250


def free_domain(first: int, ports: Collection[int]) -> int:
    """Return a domain from 1 to 101 none of whose UDP ports is in use.

    Args:
        first: any number, as that of the process; the search begins there.
        ports: UDP ports in use.
    """
    busy = {(port - _FIRST_PORT) // _PORTS for port in ports}
    candidates = [1 + (first + i) % HIGHEST_PRIVATE for i in range(HIGHEST_PRIVATE)]
    return next((domain for domain in candidates if domain not in busy), candidates[0])


def udp_ports() -> set[int]:
    """Return the UDP ports that are in use on this machine, as far as it tells."""
    ports = set()
    for table in (Path("/proc/net/udp"), Path("/proc/net/udp6")):
        try:
            rows = table.read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        ports |= {int(row.split()[1].rpartition(":")[2], 16) for row in rows if row.strip()}
    return ports
