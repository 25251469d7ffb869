"""PX4's modes and the number that carries them."""

from tombo_px4 import modes


def test_numbers_are_px4s():
    assert modes.custom_mode(modes.OFFBOARD) == 393216  # what QGroundControl logs as OFFBOARD
    assert modes.custom_mode(modes.AUTO_LAND) == 100925440
    assert modes.custom_mode(modes.AUTO_HOLD) == 50593792
