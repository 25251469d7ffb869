"""The log: every column is written in every tick."""

import numpy as np
from kernel_flight import IN_THE_WAY, NOISY, fly_kernel


def test_every_column_is_written_in_every_tick():
    flight = fly_kernel(NOISY, seconds=0.5, **IN_THE_WAY)
    assert all(np.isfinite(values).all() for values in flight.columns.values())
    quiet = {name for name, values in flight.columns.items() if not np.ptp(values, axis=0).any()}
    resting = {f"{name}_setpoint" for name in ("position", "velocity", "acceleration")}
    assert quiet <= {*resting, "mode", "damage", "fold", "contact", "contact_force"}
