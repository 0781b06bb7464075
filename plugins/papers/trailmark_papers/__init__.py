"""The experiments of the papers that this repository implements: ``trailmark reproduce``."""
