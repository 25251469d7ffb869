import math
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


def read_message(client, name, index=-1, target=(1, 1)):
    return client.mav.param_request_read_encode(*target, name.encode(), index)


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
    ("name", "value", "kind", "acts"),
    [
        ("EKF2_EV_CTRL", 99, INT32, 15),
        ("COM_OF_LOSS_T", -1.0, REAL32, 0.0),
        ("COM_OF_LOSS_T", float("inf"), REAL32, 60.0),
        ("COM_OF_LOSS_T", float("nan"), REAL32, 1.0),
    ],
)
def test_what_is_out_of_bounds_is_taken_but_acts_within_them(name, value, kind, acts, fresh):
    fresh.client.send(set_message(fresh.client, name, value, kind))
    (answer,) = of(fresh.run(0.1), "PARAM_VALUE")
    stored = int_of_float(answer.param_value) if kind == INT32 else answer.param_value
    assert stored == value or (math.isnan(value) and math.isnan(stored))
    assert fresh.vehicle.parameters.get(name) == acts


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


@pytest.mark.parametrize("target", [(2, 1), (1, 7), (0, 1)])
def test_messages_for_another_vehicle_are_left_alone(target, fresh):
    fresh.client.send(
        fresh.client.mav.param_request_list_encode(*target),
        read_message(fresh.client, "COM_OF_LOSS_T", target=target),
        set_message(fresh.client, "COM_OF_LOSS_T", 0.5, REAL32, target=target),
    )
    assert not of(fresh.run(0.2), "PARAM_VALUE")
    assert fresh.vehicle.parameters.get("COM_OF_LOSS_T") == 1.0
