"""Estimates of frames joined over time: what presses and where, and how sensors drift meanwhile."""
