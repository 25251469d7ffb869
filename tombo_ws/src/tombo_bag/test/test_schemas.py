import json
import os
from pathlib import Path

import pytest
from mcap_ros2._dynamic import generate_dynamic

from tombo_bag import schemas
from tombo_dynamics.errors import InputError

FLIGHT_TYPES = [
    "geometry_msgs/msg/PoseStamped",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/BatteryState",
    "sensor_msgs/msg/Imu",
    "tf2_msgs/msg/TFMessage",
    "visualization_msgs/msg/MarkerArray",
    *sorted(schemas.own_definitions()),
]


@pytest.mark.parametrize("typename", FLIGHT_TYPES)
def test_schema_text_is_understood_by_the_mcap_decoder(typename):
    assert typename in generate_dynamic(typename, schemas.schema_text(typename))


@pytest.mark.parametrize("typename", [*FLIGHT_TYPES, "nav_msgs/msg/Goals"])  # a learned one
def test_type_hash_is_that_of_the_installed_ros(typename):
    package, _, name = typename.split("/")
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), os.sys.prefix]
    files = [Path(p, "share", package, "msg", f"{name}.json") for p in prefixes if p]
    file = next((file for file in files if file.is_file()), None)
    if file is None:
        pytest.skip(f"{package} is not installed here")
    hashes = {
        h["type_name"]: h["hash_string"] for h in json.loads(file.read_text())["type_hashes"]
    }
    assert schemas.type_hash(typename) == hashes[typename]


def test_unknown_type_is_named_with_the_nearest_known_one():
    with pytest.raises(InputError, match=r"nav_msgs/msg/Odometri.*did you mean 'nav_msgs/msg/Odo"):
        schemas.schema_text("nav_msgs/msg/Odometri")
    with pytest.raises(InputError, match="nav_msgs/msg/Odometri"):
        schemas.type_hash("nav_msgs/msg/Odometri")


def test_text_that_is_no_definition_is_refused():
    with pytest.raises(InputError, match=r"a/msg/B.*{y}"):
        schemas.parse_schema("a/msg/B", "float64 x\n{y} 3\n")
