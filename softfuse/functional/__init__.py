"""Numbers of the configuration: what sensors read and what actuators push against."""
