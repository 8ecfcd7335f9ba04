"""Fitting a device's parameters to presses of known place and force."""
