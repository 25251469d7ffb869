"""Operating points of a propeller."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

_DEFAULT_POINTS = 50


def propeller(
    conf: int = 13,
    rpm: ArrayLike | None = None,
    law: str = "repaired",
    *,
    library: str | Path | None = None,
) -> pd.DataFrame:
    """Return thrust, drag, torque and deformation over speed, one row a point; SI units.

    Where the law is not valid, `valid` is False and the figures are NaN.

    Args:
        conf: configuration of the paper's Table I (0: rigid), or of the library.
        rpm: speeds [rpm]; None: 50 from 0 to the end of the valid range.
        law: of the nodus: published, repaired or consistent.
        library: folder with own materials, blades and configurations.

    Raises:
        InputError: unknown configuration or law, or a speed out of bounds.
    """
    import pandas as pd

    from tombo_dynamics.propeller import RPM, evaluate, read_library, valid_speed

    chosen = read_library(*(() if library is None else (Path(library),))).configuration(conf)
    speeds = (
        np.linspace(0.0, valid_speed(chosen, law), _DEFAULT_POINTS)
        if rpm is None
        else np.atleast_1d(np.asarray(rpm, dtype=np.float64)) * RPM
    )
    points = evaluate(chosen, speeds, law, outside="mask")
    return pd.DataFrame({"rpm": np.ravel(points.speed_rpm), **points.table()})
