"""What ``trailmark plugins new`` writes."""

from trailmark.scaffold.distribution import PARTS, write_distribution

__all__ = ["PARTS", "write_distribution"]
