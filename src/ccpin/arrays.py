"""Small arrays: the one alias for them, and what every room does with them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
