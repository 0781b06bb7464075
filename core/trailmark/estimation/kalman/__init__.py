"""An extended Kalman filter of the planar pose: one belief of any mix of localizers.

filterpy is imported by `ukf` alone, when it is asked for.
"""
