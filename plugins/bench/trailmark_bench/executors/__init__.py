"""Executors that come with core."""
