"""Faults of a link, found from its counters."""

from __future__ import annotations

from tombo_px4.link.link_params import LinkParams
from tombo_px4.link.mavlink_link import Link


def link_faults(link: Link, params: LinkParams, linked: bool) -> dict[str, str]:
    """Return key -> fault of the link, with cause and remedy.

    Args:
        link: what came, went and was refused.
        params: whom we wait for.
        linked: the vehicle is heard.
    """
    faults: dict[str, str] = {}
    counters, rejected_sender = link.counters, link.rejected_sender
    if link.pack_error:
        faults["unsendable"] = link.pack_error
    if linked:
        return faults
    if rejected_sender is not None and rejected_sender[0] != params.system:
        faults["wrong_system"] = (
            f"system {rejected_sender[0]} speaks here, waiting for {params.system}: set "
            "link.system, or the vehicle's MAV_SYS_ID"
        )
    elif rejected_sender is not None:
        faults["wrong_component"] = (
            f"component {rejected_sender[1]} of system {rejected_sender[0]} speaks here, "
            f"waiting for {params.component}: set link.component"
        )
    if counters["unsigned"]:
        faults["unsigned"] = (
            f"{counters['unsigned']} messages without a signature were left out: link.key_file is"
            " set here, but the other side does not sign"
        )
    if counters["bad_signature"]:
        faults["bad_signature"] = (
            f"{counters['bad_signature']} messages are signed with another key: compare"
            " link.key_file with the vehicle's key"
        )
    if counters["foreign_address"]:
        faults["foreign_address"] = (
            f"{counters['foreign_address']} datagrams came from another machine: set"
            " link.allow_remote if that is the vehicle"
        )
    if not counters["received"] and counters["garbage_bytes"] > 1000:
        faults["garbage"] = (
            f"{counters['garbage_bytes']} bytes came that are no MAVLink: baud rate, or another"
            " program on this port"
        )
    return faults
