"""Tetrahedral meshes and their closed surfaces: made, read, checked, measured."""
