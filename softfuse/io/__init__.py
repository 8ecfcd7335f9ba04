"""What is read from and written to files: quantities with units, tables of settings, their problems."""
