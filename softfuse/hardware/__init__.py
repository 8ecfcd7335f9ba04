"""Frames in and out of the computer: recordings, drivers, the live loop."""
