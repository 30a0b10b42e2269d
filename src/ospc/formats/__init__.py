"""Calibrations in the files of other programs, and the rules their parsers apply."""
