"""The log's columns: a place for everything, and nothing in two places."""

import numpy as np
from kernel_flight import IN_THE_WAY, NOISY, fly_kernel

from tombo_sim.log_columns import AT, COLUMNS, LOG_WIDTH


def test_columns_cover_the_log_once():
    count = np.zeros(LOG_WIDTH)
    for where in COLUMNS.values():
        count[where] += 1
    assert (count == 1.0).all()


def test_compiled_code_and_python_agree_on_where_columns_begin():
    assert {name: getattr(AT, name) for name in AT._fields} == {
        name: where.start for name, where in COLUMNS.items()
    }


def test_quantities_have_their_shape():
    widths = {name: where.stop - where.start for name, where in COLUMNS.items()}
    for name, width in widths.items():
        if "attitude" in name or name in ("rotor_speed", "rotor_thrust", "fold", "damage"):
            assert width == 4
    assert widths["position"] == widths["velocity"] == widths["gyro"] == widths["wind"] == 3


def test_every_column_is_written_in_every_tick():
    flight = fly_kernel(NOISY, seconds=0.5, **IN_THE_WAY)
    assert np.isfinite(flight.log).all()
    quiet = {name for name, values in flight.columns.items() if not np.ptp(values, axis=0).any()}
    resting = {f"{name}_setpoint" for name in ("position", "velocity", "acceleration")}
    assert quiet <= {*resting, "mode", "damage", "fold", "contact", "contact_force"}
