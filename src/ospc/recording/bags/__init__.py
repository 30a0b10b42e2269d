"""The contents of ROS bags: files, messages, the images in them, and the exposures recorded with the images."""
