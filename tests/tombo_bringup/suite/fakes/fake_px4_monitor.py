"""In the monitor's place: a flight on the ground, and after a while FAKE_PX4 of the bridge."""

import json
import os
import signal
import sys
import time

signal.signal(signal.SIGINT, lambda number, frame: sys.exit(0))
assert "--px4" in sys.argv
status = {
    "connected": True, "armed": False, "mode": "hold", "stage": "ready", "why": "",
    "status_text": "", "findings": [],
}  # fmt: skip
k = 0
while True:
    flight = {"stamp_ns": 10**18 + k * 50_000_000, "height_m": 0.18, "upright": 1.0, "phase": 1}
    if k == 20:  # all others have started
        status |= json.loads(os.environ["FAKE_PX4"])
    for said in ({"px4": status}, {"flight": flight}):
        sys.stdout.write(json.dumps(said) + "\n")
    sys.stdout.flush()
    time.sleep(0.05)
    k += 1
