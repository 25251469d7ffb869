"""The type of the arrays of numbers, of any shape."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Times = NDArray[np.int64]
"""Stamps [ns]."""
