"""A planar laser and a floor plan: occupancy grids of ROS, read, written and drawn from a taught place."""
