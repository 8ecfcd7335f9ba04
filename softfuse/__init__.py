"""Where, how hard and into what shape a soft body is being pushed, from sensors inside it."""
