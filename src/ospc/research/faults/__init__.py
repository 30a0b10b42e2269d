"""Faults of recordings: each is put on good recordings, to see whether a calibration notices, copes, or is wrong."""
