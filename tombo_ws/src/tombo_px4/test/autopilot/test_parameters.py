"""The table of parameters: PX4's names, types, bounds and meanings."""

from tombo_px4.autopilot.parameters import PARAMETERS


def test_every_parameter_has_a_default_within_its_bounds_and_a_meaning():
    for p in PARAMETERS:
        assert p.low <= p.default <= p.high, p.name
        assert len(p.doc) > 8 and "\n" not in p.doc, p.name
        assert p.kind == "float" or all(v == int(v) for v in (p.default, p.low, p.high)), p.name
