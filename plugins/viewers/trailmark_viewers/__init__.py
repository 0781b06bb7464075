"""Sinks for programs that show what a robot sees and believes."""
