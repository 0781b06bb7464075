"""What people use instead of landmarks with an RGB-D camera: ORB, depth, RANSAC and Kabsch."""
