"""Differential visual streams: how far a robot has left its taught path, from what changes in the picture.

H. Perroni Filho, A. Ohya: Mobile Robot Path Drift Estimation Using Visual Streams, 2014.
"""
