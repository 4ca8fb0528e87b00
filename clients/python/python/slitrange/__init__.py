"""Readings of a slitrange laser range sensor, and its estimators on your own rows.

`open` opens a sensor at a serial port. `centres` runs the sensor's core on rows in numpy arrays.
"""

from slitrange.rows import ESTIMATORS, FAULTS, TCD1304DG, Centres, Geometry, centres

__all__ = [
    "ESTIMATORS",
    "FAULTS",
    "TCD1304DG",
    "Centres",
    "Geometry",
    "centres",
]
