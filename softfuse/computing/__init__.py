"""How the commands compute: precision, kept programs, processes side by side."""

from softfuse.computing.prepare import prepare_jax

__all__ = ["prepare_jax"]
