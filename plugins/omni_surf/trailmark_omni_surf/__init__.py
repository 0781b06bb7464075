"""Omnidirectional camera and laser (Tasaki et al. 2010)."""
