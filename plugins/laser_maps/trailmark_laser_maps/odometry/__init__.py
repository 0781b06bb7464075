"""Motion from planar scans alone."""
