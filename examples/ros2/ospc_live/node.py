"""A node that calibrates a camera while it films, and publishes what to film next."""

from importlib import import_module

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.task import Future
from sensor_msgs.msg import Image
from std_msgs.msg import String

from ospc import LiveCalibrator
from ospc.errors import OspcError
from ospc.recording.live.ros import RosFrames
from ospc.recording.options import ReadingOptions

OPTIONS = ("channel", "exposure_field", "exposure_unit", "gain_field", "gain_unit")
"""Reading options, as for ospc calibrate; needed for message types that ospc does not know."""


class LiveCalibration(Node):
    """Calibrates from a driver's images and exposures; saves the result when everything is known, and on shutdown."""

    def __init__(self):
        super().__init__("ospc_live")
        kind = self.declare_parameter("exposure_type", "flir_camera_msgs/msg/ImageMetaData").value
        self.out = self.declare_parameter("out", "calibration.json").value
        max_grey = self.declare_parameter("max_grey", 0).value or None
        options = {name: self.declare_parameter(name, "").value or None for name in OPTIONS}
        self.frames = RosFrames(kind, ReadingOptions.of(options), max_grey=max_grey)
        self.live, self.done = LiveCalibrator(), Future()
        package, _, name = kind.split("/")
        message = getattr(import_module(f"{package}.msg"), name)
        self.advice = self.create_publisher(String, "~/advice", 1)
        self.create_subscription(Image, "image", self.taker(self.frames.image), qos_profile_sensor_data)
        self.create_subscription(message, "exposure", self.taker(self.frames.exposure), qos_profile_sensor_data)
        self.create_timer(1.0, self.advise)

    def taker(self, frame_of):
        """Return the callback for a topic."""

        def take(message):
            try:
                frame = frame_of(message)
            except OspcError as error:
                self.get_logger().warning(str(error), throttle_duration_sec=5.0)
                return
            if frame is not None:
                self.live.push(frame)  # returns at once

        return take

    def advise(self):
        """Publish what to film next; end when everything is known."""
        self.advice.publish(String(data=self.live.status.advice))
        if self.live.status.instruction.kind == "done" and not self.done.done():
            self.done.set_result(True)

    def save(self):
        """Save the calibration so far."""
        try:
            self.live.calibration().save(self.out)
            print(f"saved {self.out}")  # the logger does not work after the node was shut down
        except OspcError as error:
            print(error)
        finally:
            self.live.close()


def main():
    """Run the node until everything is known, or until Ctrl-C."""
    rclpy.init()
    node = LiveCalibration()
    try:
        rclpy.spin_until_future_complete(node, node.done)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.save()
        node.destroy_node()
        rclpy.try_shutdown()
