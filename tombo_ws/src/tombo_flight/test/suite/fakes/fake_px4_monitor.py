"""In the monitor's place: a flight on the ground, then FAKE_PX4, at last FAKE_PX4_THEN."""

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
bridge = {"name": "px4_bridge", "level": 0, "message": "", "values": {}}
k = 0
while True:
    flight = {"stamp_ns": 10**18 + k * 50_000_000, "height_m": 0.18, "upright": 1.0, "phase": 1}
    if k == 20:  # all others have started
        status |= json.loads(os.environ["FAKE_PX4"])
    if k >= 30:
        then = json.loads(os.environ.get("FAKE_PX4_THEN", "{}"))
        flight["phase"] = then.pop("phase", 1)
        status |= then
    if "faults" in status:
        bridge["values"] = {f"fault.{status.pop('faults')}": "active, 1 times"}
    for said in ({"diagnostics": [bridge]}, {"px4": status}, {"flight": flight}):
        sys.stdout.write(json.dumps(said) + "\n")
    sys.stdout.flush()
    time.sleep(0.05)
    k += 1
