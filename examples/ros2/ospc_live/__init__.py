"""A ROS 2 node that calibrates a camera while it films."""
