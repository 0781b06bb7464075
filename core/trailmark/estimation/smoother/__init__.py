"""A fixed-lag smoother of the planar pose: the poses of a window of time are estimated together."""
