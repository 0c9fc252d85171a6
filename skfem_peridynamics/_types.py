"""The array types of the annotations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

Floats: TypeAlias = npt.NDArray[np.float64]
Ints: TypeAlias = npt.NDArray[np.int32]
Longs: TypeAlias = npt.NDArray[np.int64]
Bools: TypeAlias = npt.NDArray[np.bool_]
Load: TypeAlias = Callable[[float], Floats]
Csr: TypeAlias = sparse.csr_matrix
# scikit-fem ships no annotations: its meshes and bases are Any here, and named for the reader.
Mesh: TypeAlias = Any
Basis: TypeAlias = Any
