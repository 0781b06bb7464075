"""SURF of our own: OpenCV's wheels leave it out (Bay, Tuytelaars & Van Gool 2006)."""
