"""Starts the node with the topics of a driver."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

ARGUMENTS = {
    "image": ("/camera/image_raw", "topic of the images"),
    "exposure": ("/camera/meta", "topic of the exposures"),
    "exposure_type": ("flir_camera_msgs/msg/ImageMetaData", "type of its messages"),
    "out": ("calibration.json", "file to save"),
}


def generate_launch_description():
    """Return the node, with its topics and parameters as arguments."""
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    node = Node(
        package="ospc_live",
        executable="live",
        output="screen",
        remappings=[(name, given[name]) for name in ("image", "exposure")],
        parameters=[{name: given[name] for name in ("exposure_type", "out")}],
    )
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, node])
