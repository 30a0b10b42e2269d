"""Many recordings of many cameras: calibrated wherever there is room, those of one camera merged."""
