"""PX4's modes and the number that carries them."""

import pytest

from tombo_px4 import modes

ALL = [value for value in vars(modes).values() if isinstance(value, modes.Mode)]


def test_numbers_are_px4s():
    assert modes.custom_mode(modes.OFFBOARD) == 393216  # what QGroundControl logs as OFFBOARD
    assert modes.custom_mode(modes.AUTO_LAND) == 100925440
    assert modes.custom_mode(modes.AUTO_HOLD) == 50593792


@pytest.mark.parametrize("mode", ALL, ids=modes.mode_name)
def test_a_mode_comes_back_from_its_number(mode):
    assert modes.mode_of(modes.custom_mode(mode)) == mode


def test_an_unknown_number_has_a_name_to_read():
    assert modes.mode_name(modes.mode_of(9 << 16)) == "mode 9.0"
