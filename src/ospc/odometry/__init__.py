"""What a calibration does for direct visual odometry: the paper's experiments I, II, III and "II modified"."""
