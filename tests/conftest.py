"""Every test runs in double precision, as the mechanics requires."""

import jax

jax.config.update("jax_enable_x64", True)
