"""``trailmark calibrate rgbd``: which depth pixel belongs to which colour pixel, from a rectangle that is moved."""
