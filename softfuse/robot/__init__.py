"""A robot as a list of parts with names: from a TOML file to its model, its sensors and where everything is."""
