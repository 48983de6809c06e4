"""Reading videos with distrust, keeping their frames, writing videos."""
