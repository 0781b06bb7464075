"""A planar laser and a floor plan: occupancy grids of ROS, a robot found on them, and motion from scans alone."""
