"""The calibration methods, which turn frames into a calibration."""
