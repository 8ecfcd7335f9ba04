"""Fitting a robot's parameters to presses of known place and force."""
