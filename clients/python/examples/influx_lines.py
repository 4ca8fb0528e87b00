"""Prints each result as a line for InfluxDB: python influx_lines.py /dev/ttyACM0."""

import sys
import time

import slitrange


def influx_line(result: slitrange.Reading | slitrange.Fault, time_ns: int) -> str:
    """A line of InfluxDB's line protocol: a reading as numbers, a fault as its name."""
    if isinstance(result, slitrange.Fault):
        fields = f'fault="{result.name}"'
    else:
        fields = f'distance_mm={result.distance_mm},u_mm={result.u_mm},flags="{result.flags}"'
    return f"slitrange {fields} {time_ns}"


if __name__ == "__main__":
    with slitrange.open(sys.argv[1]) as sensor:
        for result in sensor:
            # Each line at once, also into a pipe.
            print(influx_line(result, time.time_ns()), flush=True)
