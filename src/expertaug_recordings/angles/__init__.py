"""Angles, speeds and energy from marker positions, and what the motion says of pendulum and camera."""
