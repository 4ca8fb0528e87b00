"""Readings of a slitrange laser range sensor, and its estimators on your own rows.

`open` opens a sensor at a serial port. `centres` runs the sensor's core on rows in numpy arrays.
"""

from slitrange import packets
from slitrange.errors import NoAnswer, PortError, Refused, Restarted, SlitrangeError, WrongUse
from slitrange.readings import Centre, Fault, Reading, Row, UncertaintyParts
from slitrange.rows import ESTIMATORS, FAULTS, TCD1304DG, Centres, Geometry, centres
from slitrange.sensor import Sensor, open

__all__ = [
    "ESTIMATORS",
    "FAULTS",
    "TCD1304DG",
    "Centre",
    "Centres",
    "Fault",
    "Geometry",
    "NoAnswer",
    "PortError",
    "Reading",
    "Refused",
    "Restarted",
    "Row",
    "Sensor",
    "SlitrangeError",
    "UncertaintyParts",
    "WrongUse",
    "centres",
    "open",
    "packets",
]
