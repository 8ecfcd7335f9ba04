"""A robot as a list of named parts: from a TOML file to its model, its sensors and where everything is."""
