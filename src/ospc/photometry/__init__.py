"""Photometric models: response, vignette, noise, and the calibration of a camera."""
