"""What can be wrong with a sensor: faults of pictures, depth, scans, time and calibration."""
