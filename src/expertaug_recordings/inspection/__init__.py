"""What a video of an unknown pendulum shows, and the configuration that would track it."""
