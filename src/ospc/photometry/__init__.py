"""What a camera does to light: response, vignette, noise, and a calibration as a value."""
