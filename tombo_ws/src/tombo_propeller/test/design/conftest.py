"""Designs on a coarser grid than the command's, each made once."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

from tombo_dynamics.propeller import read_library
from tombo_propeller.design import candidates
from tombo_propeller.design.design import Design, design
from tombo_propeller.design.request import DesignRequest

COARSE = {
    "FIBRE_COUNTS": (3, 5, 8),
    "DIAMETERS_MM": (0.5, 0.9),
    "LENGTHS_MM": (8.0, 12.0, 16.0),
    "OUTER_RADII_MM": (35.0, 45.0),
}


@lru_cache(maxsize=32)
def _made(library: Path | None, **request: Any) -> Design:
    known = read_library() if library is None else read_library(library)
    with patch.multiple(candidates, **COARSE):
        return design(DesignRequest(**request), known, known.blades["nine_inch"])


@pytest.fixture(scope="session")
def made() -> Callable[..., Design]:
    """Return the design for a request; `library` is a folder."""

    def make(library: Path | None = None, **request: Any) -> Design:
        return _made(library, **request)

    return make


STIFF = """
matrices:
  Stiff50:
    poisson_ratio: 0.40
    strain_percent: [1, 2, 3, 4, 5, 6]
    secant_modulus_MPa: [1.5, 1.49, 1.47, 1.46, 1.44, 1.42]
"""


@pytest.fixture(scope="session")
def stiff_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a silicone twice as stiff as DragonSkin 30."""
    folder = tmp_path_factory.mktemp("stiff")
    (folder / "materials.yaml").write_text(STIFF)
    return folder


MEASURED_20 = """
- conf: 20
  blade: nine_inch
  matrix: Stiff50
  fibre: tendon
  fibres: 5
  fibre_diameter_mm: 0.5
  length_mm: 12.0
"""
TABLE_20 = """
at_2000_rpm:
  - conf: 20
    thrust_N: 0.65
    thrust_dev_N: 0.03
    collision_force_N: 118.0
    recovery_s: 0.3
    noise_dB: 48.0
"""


@pytest.fixture(scope="session")
def measured_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a configuration of its own that was measured, too."""
    folder = tmp_path_factory.mktemp("measured")
    (folder / "materials.yaml").write_text(STIFF)
    (folder / "configurations.yaml").write_text(MEASURED_20)
    (folder / "measurements.yaml").write_text(TABLE_20)
    return folder
