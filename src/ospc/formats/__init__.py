"""Calibration files of other programs, and the rules of their parsers."""
