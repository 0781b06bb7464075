"""Monte Carlo localization on an occupancy grid."""
