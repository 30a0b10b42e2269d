"""The effect of a calibration on direct visual odometry: the paper's experiments I, II, III and "II modified"."""
