"""The frames of messages: world `map` (ENU), body `base_link` (FLU)."""

from __future__ import annotations

from typing import Final

FRAME_MAP: Final = "map"
FRAME_ODOM: Final = "odom"
"""Between the others by REP-105; equal to `map`, because motion capture does not drift."""
FRAME_BODY: Final = "base_link"


def is_map(frame_id: str) -> bool:
    """Return whether a message is in the world frame."""
    return frame_id.lstrip("/") == FRAME_MAP
