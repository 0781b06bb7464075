"""Planar scans: their walls, how they lie on each other, and how sure that is.

Import what is needed from the modules: they bring scipy and compiled kernels.
"""
