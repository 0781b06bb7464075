"""Trailmark plugin: beliefs as MAVLink."""
