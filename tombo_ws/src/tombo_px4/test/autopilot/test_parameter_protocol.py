import struct

import pytest
from endpoint_bench import bench, of

from tombo_px4.link.messages import float_of_int

INT32, REAL32 = 6, 9


def int_of_float(value):
    return struct.unpack("<i", struct.pack("<f", value))[0]


def set_message(client, name, value, kind, target=(1, 1)):
    sent = float_of_int(value) if kind == INT32 else value
    return client.mav.param_set_encode(*target, name.encode(), sent, kind)


def test_the_list_is_complete_in_the_order_of_the_names(fresh):
    fresh.client.send(fresh.client.mav.param_request_list_encode(1, 1))
    values = of(fresh.run(1.0), "PARAM_VALUE")
    names = sorted(fresh.vehicle.parameters.names)
    assert [v.param_id for v in values] == names
    assert [v.param_index for v in values] == list(range(len(names)))
    assert {v.param_count for v in values} == {len(names)}
    for value in values:
        known = fresh.vehicle.parameters
        whole = known.type_of(value.param_id) == "int32"
        assert value.param_type == (INT32 if whole else REAL32)
        stored = int_of_float(value.param_value) if whole else value.param_value
        assert stored == known.get(value.param_id)


def test_a_new_value_acts_and_is_told_on_every_link():
    with bench("onboard", "ground") as b:
        b.client.send(set_message(b.client, "EKF2_EV_CTRL", 11, INT32))
        b.client.send(set_message(b.client, "COM_OF_LOSS_T", 0.5, REAL32))
        b.run(0.1)
        assert b.vehicle.parameters.get("EKF2_EV_CTRL") == 11
        for client in b.clients:
            values = {v.param_id: v.param_value for v in of(client.seen, "PARAM_VALUE")}
            assert int_of_float(values["EKF2_EV_CTRL"]) == 11
            assert values["COM_OF_LOSS_T"] == 0.5


@pytest.mark.parametrize(
    ("name", "value", "kind"),
    [("EKF2_EV_CTRL", 3.0, REAL32), ("COM_OF_LOSS_T", 1, INT32), ("NO_SUCH", 1.0, REAL32)],
)
def test_to_a_wrong_type_or_name_px4_is_silent(name, value, kind, fresh):
    table = fresh.vehicle.parameters
    before = [*table.stored.values()]
    for _ in range(50):
        fresh.client.send(set_message(fresh.client, name, value, kind))
    heard = fresh.run(0.2)
    assert not [m for m in heard if m.get_type() in ("PARAM_VALUE", "PARAM_ERROR", "STATUSTEXT")]
    assert [*table.stored.values()] == before
    assert any(name in why for why in fresh.endpoint.refused)
