"""Checks of the values in a run's state, made when it is loaded and before anything uses it."""
