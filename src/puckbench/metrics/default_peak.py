PEAK_M = 30.0
"""Default PSNR peak, in m, for clouds in metres: 30,000 units of 1 mm, as in MPEG's common test
conditions for LiDAR. Papers on KITTI use 59.70 m."""
