"""Publishes readings to ROS 2 as sensor_msgs/Range: python ros_range.py /dev/ttyACM0.

It needs a shell in which ROS 2 is set up (source /opt/ros/jazzy/setup.bash), and this package.
"""

import contextlib
import math
import sys

import rclpy
from sensor_msgs.msg import Range

import slitrange

NEAREST_M, FARTHEST_M = 0.60, 1.02
"""The range of the nominal sensor. Put in yours: where your calibration begins and ends."""

SPOT_M = 0.002
"""The diameter of the laser's spot on the target."""


def range_of(result: slitrange.Reading | slitrange.Fault) -> Range:
    """The message of a result, without its time.

    A fault has no distance. REP 117 says what stands in its place: NaN, because a fault does not say whether
    the target is too near, too far or too dark.
    """
    message = Range()
    message.header.frame_id = "slitrange"
    # ROS has no number for visible light. This is the one for light.
    message.radiation_type = Range.INFRARED
    message.field_of_view = SPOT_M / FARTHEST_M
    message.min_range, message.max_range = NEAREST_M, FARTHEST_M
    if isinstance(result, slitrange.Fault):
        message.range = math.nan
        return message
    message.range = 1e-3 * result.distance_mm
    # Range has a variance since ROS 2 Iron.
    if hasattr(message, "variance"):
        message.variance = (1e-3 * result.u_mm) ** 2
    return message


def main(port: str) -> None:
    """Publishes the results of the sensor at a port on the topic `range`."""
    rclpy.init()
    node = rclpy.create_node("slitrange")
    publisher = node.create_publisher(Range, "range", 10)
    # Ctrl-C ends the loop, and the sensor gets its own settings back.
    with contextlib.suppress(KeyboardInterrupt), slitrange.open(port) as sensor:
        for result in sensor:
            message = range_of(result)
            message.header.stamp = node.get_clock().now().to_msg()
            publisher.publish(message)


if __name__ == "__main__":
    main(sys.argv[1])
