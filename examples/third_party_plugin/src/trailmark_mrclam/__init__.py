"""Landmarks of the UTIAS MRCLAM data sets for Trailmark."""
