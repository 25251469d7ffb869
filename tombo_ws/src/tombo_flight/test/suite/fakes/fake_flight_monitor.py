"""In the monitor's place: reports a flight that takes off, then follows FAKE_FLIGHT."""

import json
import os
import signal
import sys
import time

signal.signal(signal.SIGINT, lambda number, frame: sys.exit(0))
assert sys.argv[1:] == ["--flight"]
ends = {"land": (0.18, 7)}
k = 0
recorded = os.environ["FAKE_FLIGHT"] != "early"
while recorded and not os.path.exists(os.environ["FAKE_METADATA"]):  # the recorder runs
    time.sleep(0.02)
while True:
    flying = k > 4
    height, phase = (
        ends.get(os.environ["FAKE_FLIGHT"], (2.0, 2)) if k > 45 else (2.0 if flying else 0.18, 1)
    )
    state = {
        "stamp_ns": 10**18 + k * 250_000_000,
        "height_m": height,
        "upright": 1.0,
        "phase": phase if k > 2 else None,
    }
    sys.stdout.write(json.dumps({"flight": state}) + "\n")
    sys.stdout.flush()
    if os.environ["FAKE_FLIGHT"] == "early" and k == 3:
        os.kill(os.getppid(), signal.SIGINT)
    time.sleep(0.02)
    k += 1
