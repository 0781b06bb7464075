"""Live ROS 2 without ROS installed: a robot's topics as a source, beliefs as a sink."""
