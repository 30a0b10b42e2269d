"""The contents of ROS bags: files, messages, images, and their exposures."""
