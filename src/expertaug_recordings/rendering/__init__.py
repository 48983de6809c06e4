"""Recordings simulated and drawn as video, for those who have no pendulum and no camera."""
