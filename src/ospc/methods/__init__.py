"""The calibration methods: frames in, calibration out, one step of the method a line."""
