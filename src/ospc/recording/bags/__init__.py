"""What is in a ROS bag: containers, messages, images in them, and exposures that came with the images."""
