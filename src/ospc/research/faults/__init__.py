"""The fault study: adds faults to good recordings to see whether calibration detects, corrects or misses them."""
