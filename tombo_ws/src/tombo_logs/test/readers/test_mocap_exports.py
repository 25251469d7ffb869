"""Exports of motion-capture software give the same flight, whatever the software."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tombo_dynamics.errors import InputError
from tombo_logs.proposal.explain import explain_mapping
from tombo_logs.readers.log_reader import read_log

T = np.arange(200) / 100.0
PLACE = np.column_stack([np.sin(T), 0.5 * np.cos(T), 1.0 + 0.1 * T])
"""In map (ENU)."""
TURN = Rotation.from_euler("ZYX", np.column_stack([0.5 * T, 0.1 * np.sin(T), 0.2 * np.cos(T)]))
MOTIVE_HEADER = """Format Version,1.23,Take Name,a,Rotation Type,{rotation},Length Units,{unit}

,Type,{kinds}
,Name,{names}
,ID,{ids}
,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error
Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,
"""


def motive(unit="Meters", scale=1.0, rotation="Quaternion", names=None):
    """Y up: x as in map, y = z of map, z = -y of map; the body's axes alike."""
    x, y, z, w = TURN.as_quat().T
    places = scale * PLACE[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
    rows = np.column_stack([np.arange(T.size), T, x, z, -y, w, places, 1e-4 + 0.0 * T])
    head = MOTIVE_HEADER.format(
        rotation=rotation, unit=unit, kinds=",".join(8 * ["Rigid Body"]),
        names=",".join(names or 8 * ["drone"]), ids=",".join(8 * ["5"]),
    )  # fmt: skip
    return head + "\n".join(",".join(f"{v:.6f}" for v in row) for row in rows) + "\n"


def qtm(times=True):
    matrices = TURN.as_matrix().transpose(0, 2, 1).reshape(-1, 9)
    rows = np.column_stack([np.arange(T.size), T, 1e3 * PLACE, np.zeros((T.size, 4)), matrices])
    rows = rows[:, 0 if times else 2 :]
    head = "NO_OF_FRAMES\t200\r\nFREQUENCY\t100\r\nDATA_INCLUDED\t6D\r\nBODY_NAMES\tdrone\r\n"
    names = ["Frame", "Time", "drone X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual"]
    names = names[0 if times else 2 :]
    head += "\t".join([*names, *(f"Rot[{k}]" for k in range(9))])
    return "\r\n".join([head, *("\t".join(f"{v:.6f}" for v in row) for row in rows), ""])


def tum():
    rows = np.column_stack([T, PLACE, TURN.as_quat()])
    lines = [" ".join(f"{v:.6f}" for v in row) for row in rows]
    return "\n".join(["# timestamp tx ty tz qx qy qz qw", *lines, ""])


EXPORTS = {
    "motive": motive(),
    "motive in millimetres": motive("Millimeters", 1e3),
    "qtm": qtm(),
    "qtm without times": qtm(times=False),
    "tum": tum(),
}


@pytest.mark.parametrize("export", EXPORTS)
def test_an_export_is_read_without_a_mapping(tmp_path, export):
    path = tmp_path / "take.csv"
    path.write_text(EXPORTS[export], newline="")
    log = read_log(path, "take")
    assert log.series["position"].t == pytest.approx(T)
    assert log.series["position"].values == pytest.approx(PLACE, abs=2e-6)
    turned = Rotation.from_quat(log.series["attitude"].values)
    assert (turned * TURN.inv()).magnitude().max() < 1e-4
    assert "columns" in explain_mapping(path)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (motive(rotation="XYZ").replace("Y,Z,W,X", "Y,Z,,X"), "Rotation Type Quaternion"),
        (motive(names=[*7 * ["drone"], "wand"]), "drone.Position.X"),
        ("Objects\n100\n,,drone\nFrame,Sub Frame,RX\n1,0,2\n", "Vicon Tracker"),
        ("NO_OF_FRAMES\t1\nFrame\tTime\n1\t0.0\n", "rigid bodies"),
        (qtm(times=False).replace("FREQUENCY\t100", "FREQUENCY\tfast"), "FREQUENCY is 'fast'"),
        (qtm(times=False).replace("FREQUENCY\t100", "FREQUENCY"), "FREQUENCY is ''"),
    ],
    ids=["Euler angles", "two bodies", "Vicon", "no bodies", "no number", "no frequency"],
)
def test_an_export_without_the_poses_of_one_body_is_refused(tmp_path, text, named):
    path = tmp_path / "take.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=named):
        read_log(path, "take")
