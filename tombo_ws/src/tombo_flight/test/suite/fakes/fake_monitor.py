"""In the monitor's place: says that two nodes are there, one of them not well."""

import json
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
while True:
    for statuses in (report, sick):
        sys.stdout.write(json.dumps({"diagnostics": statuses}) + "\n")
        sys.stdout.flush()
    time.sleep(0.1)
