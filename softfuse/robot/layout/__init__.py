"""Blocks and beams with chambers of any shape: generated bodies, whose meshes follow their parameters."""
