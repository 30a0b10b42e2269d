"""Reports and pictures of calibrations; matplotlib draws all charts."""
