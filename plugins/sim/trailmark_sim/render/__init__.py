"""Rendering: a ray caster over textured rectangles, upright cylinders and ellipsoids, for any central camera."""
