"""``trailmark bench`` on the command line."""
