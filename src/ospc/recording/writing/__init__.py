"""Recordings written as folders in the layout of the TUM monocular data set."""
