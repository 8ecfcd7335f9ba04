"""What works on this computer and on its ports and what does not, each with what to do about it."""
