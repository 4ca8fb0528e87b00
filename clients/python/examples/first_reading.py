"""Prints the first readings of a sensor: python first_reading.py /dev/ttyACM0."""

import itertools
import sys

import slitrange

with slitrange.open(sys.argv[1]) as sensor:
    for reading in itertools.islice(sensor, 5):
        if isinstance(reading, slitrange.Fault):
            print("no distance:", reading.name, reading.detail)
        else:
            print(f"{reading.distance_mm:.4f} mm, u {reading.u_mm:.4f} mm, flags {reading.flags or 'none'}")
