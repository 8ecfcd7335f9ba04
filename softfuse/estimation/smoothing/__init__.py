"""Estimates of frames over time: what presses and where, and how sensors drift meanwhile."""
