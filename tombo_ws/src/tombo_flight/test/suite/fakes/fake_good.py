"""A node that does as it is told: ends at SIGINT, with 0."""

import signal
import sys
import time

sys.stdout.write(f"[INFO] [1.0] [{sys.argv[0]}]: running\n")
signal.signal(signal.SIGINT, lambda number, frame: sys.exit(0))
while True:
    time.sleep(0.05)
