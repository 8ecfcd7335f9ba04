"""Measurement models: what raw sensor readings say about deformation, contacts and their places."""
