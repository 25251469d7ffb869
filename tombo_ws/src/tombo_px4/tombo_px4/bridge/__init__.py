"""Speaking to PX4: the link, its clocks, and the only place of NED and FRD."""
