"""Tables of readings as other programs write them: text in whatever dialect, read block by block."""
