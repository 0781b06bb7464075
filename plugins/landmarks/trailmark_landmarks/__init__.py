"""Known landmarks: beacons, fiducials, radios at surveyed places, seen at ranges, bearings or both."""
