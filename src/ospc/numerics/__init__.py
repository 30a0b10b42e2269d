"""Numerical methods that numpy and scipy lack."""
