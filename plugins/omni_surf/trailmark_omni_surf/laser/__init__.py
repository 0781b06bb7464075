"""Planar scan matching against a taught map: usable alone, without a camera and without the pipeline.

::

    from trailmark_omni_surf import ScanMap, match_scan

    scan_map = ScanMap.from_scans(scans, poses)
    match = match_scan(scan_map, points_base, pose_guess)
    match.pose_map_base, match.information, match.inlier_share
"""
