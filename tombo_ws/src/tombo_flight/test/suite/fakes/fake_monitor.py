"""In the monitor's place: two nodes, one of them not well, a hover, and an answer to requests."""

import json
import os
import select
import signal
import sys
import time

signal.signal(signal.SIGINT, lambda number, frame: sys.exit(0))
rate = {"rate_hz": "999.5", "jitter_p50_us": "3.0", "jitter_p99_us": "41.0", "missed": "7"}
report = [
    {"name": "sim", "level": 0, "message": "ok", "values": {"scheduling": "FIFO 50"}},
    {"name": "sim: loop", "level": 0, "message": "", "values": rate},
]
sick = [
    {
        "name": "detector",
        "level": 1,
        "message": "mocap_silent: no pose for 1 s",
        "values": {"mocap_age_s": "1.25"},
    }
]
flight = {"stamp_ns": 5, "height_m": 2.014, "upright": 1.0, "phase": 2}
while True:
    sys.stdout.write(json.dumps({"flight": flight}) + "\n")
    ready, _, _ = select.select([0], [], [], 0.0)
    for asked in os.read(0, 4096).decode().split() if ready else ():
        answer = {"request": asked, "success": asked != "land", "message": f"asked to {asked}"}
        sys.stdout.write(json.dumps({"answer": answer}) + "\n")
    for statuses in (report, sick):
        sys.stdout.write(json.dumps({"diagnostics": statuses}) + "\n")
        sys.stdout.flush()
    time.sleep(0.1)
