"""A server of OptiTrack's NatNet 3.1 protocol, as Motive is one: unicast on this machine.

Written from the published packet format: the client asks on the command port who the server is
and which rigid bodies there are; frames come to its data port.
"""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Mapping, Sequence

_CONNECT, _SERVER_INFO, _REQUEST_MODEL, _MODEL, _FRAME = 0, 1, 4, 5, 7
_RIGID_BODY = 1
_CLOCK_HZ = 1_000_000


class NatNetServer:
    """Answers commands on a thread of its own; `send` sends a frame."""

    def __init__(self, bodies: Sequence[str]) -> None:
        self._ids = {name: number for number, name in enumerate(bodies, start=1)}
        self._commands = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._commands.bind(("127.0.0.1", 0))
        self._frames = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self.data_port = free.getsockname()[1]
        self.command_port = self._commands.getsockname()[1]
        self.asked = threading.Event()
        """Somebody has asked for the rigid bodies."""
        self._number = 0
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                request, client = self._commands.recvfrom(1024)
            except OSError:
                return
            kind = struct.unpack_from("<H", request)[0]
            if kind == _CONNECT:
                self._commands.sendto(self._server_info(), client)
            elif kind == _REQUEST_MODEL:
                self._commands.sendto(self._model(), client)
                self.asked.set()

    def _server_info(self) -> bytes:
        version = bytes([3, 1, 0, 0])
        info = b"Motive".ljust(256, b"\0") + version + version
        info += struct.pack("<QH?4s", _CLOCK_HZ, self.data_port, False, bytes(4))
        return _packet(_SERVER_INFO, info)

    def _model(self) -> bytes:
        content = struct.pack("<i", len(self._ids))
        for name, number in self._ids.items():
            content += struct.pack("<i", _RIGID_BODY) + name.encode() + b"\0"
            content += struct.pack("<ii3fi", number, -1, 0.0, 0.0, 0.0, 0)
        return _packet(_MODEL, content)

    def send(self, poses: Mapping[str, Sequence[float]], lost: Sequence[str] = ()) -> None:
        """Send a frame: name → x, y, z, qx, qy, qz, qw; `lost` are bodies that no camera sees."""
        self._number += 1
        content = struct.pack("<iiii", self._number, 0, 0, len(poses) + len(lost))
        for name, pose in {**poses, **dict.fromkeys(lost, (0.0,) * 7)}.items():
            content += struct.pack("<i7ffh", self._ids[name], *pose, 0.0, int(name not in lost))
        # no skeletons, labelled markers, force plates, devices; time codes and stamps
        content += struct.pack("<iiiiIIdQQQhi", 0, 0, 0, 0, 0, 0, 0.0, 0, 0, 0, 0, 0)
        self._frames.sendto(_packet(_FRAME, content), ("127.0.0.1", self.data_port))

    def close(self) -> None:
        """End it."""
        self._commands.close()
        self._frames.close()


def _packet(kind: int, content: bytes) -> bytes:
    return struct.pack("<HH", kind, len(content)) + content
