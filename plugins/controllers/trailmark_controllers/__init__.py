"""Controllers that bring a robot along a taught path."""
