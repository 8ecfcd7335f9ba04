"""Layouts of cavities whose parameters are free, and what follows from them."""
