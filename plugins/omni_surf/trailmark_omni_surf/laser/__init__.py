"""Planar scan matching against a taught map: usable alone, without a camera and without the pipeline.

::

    scan_map = ScanMap.from_scans(scans, poses)
    match = match_scan(scan_map, points_base, pose_guess)
    match.pose_map_base, match.information, match.inlier_share
"""

from trailmark_omni_surf.laser.matching import ScanMatch, SearchWindow, match_scan
from trailmark_omni_surf.laser.scan_map import ScanMap

__all__ = ["ScanMap", "ScanMatch", "SearchWindow", "match_scan"]
