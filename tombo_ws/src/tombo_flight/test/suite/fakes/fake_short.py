"""A node that runs for a while and then dies of a bug."""

import sys
import time

sys.stdout.write("[WARN] [1.0] [mission]: odometry_silent: no odometry\n")
time.sleep(0.4)
raise RuntimeError("a bug")
