"""Blocks and beams with chambers of any shape: a generator of bodies, whose meshes follow their parameters."""
