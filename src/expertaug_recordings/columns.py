"""Columns of marker tables (markers.csv), written by tracking and by import, read by all that follows."""

PLACES = ("pivot_x", "pivot_y", "joint_x", "joint_y", "tip_x", "tip_y")  # px, x right, y down
MARKERS = ("frame", "t", *PLACES, "quality", "reason")
