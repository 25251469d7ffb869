"""A node that hears no signal, and has a child that doesn't either."""

import os
import signal
import time

for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, signal.SIG_IGN)
os.fork()
while True:
    time.sleep(0.05)
