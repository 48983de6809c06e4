"""Recordings of a double pendulum, from video or marker files to chunks of its motion."""
