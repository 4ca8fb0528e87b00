import numpy as np
import numpy.typing as npt

ESTIMATORS: list[str]
FAULTS: list[str]
LARGEST_COUNT: int
MAX_PIXELS: int
MAX_ROWS: int
MIN_PIXELS: int

_Layout = tuple[int, tuple[int, int], tuple[int, int], bool, int, float, int]

def tcd1304dg() -> _Layout: ...
def centres(
    rows: npt.NDArray[np.uint16],
    estimator: str,
    layout: _Layout,
    black_level: str,
    frame: int,
) -> tuple[list[npt.NDArray[np.float64]], list[npt.NDArray[np.uint16]], npt.NDArray[np.int8]]: ...
