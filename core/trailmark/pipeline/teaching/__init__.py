"""The taught place: its path store, the waypoints that are laid, and the format of what localizers remember."""
