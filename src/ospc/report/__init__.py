"""Reports and pictures of calibrations, all charts drawn with matplotlib."""
