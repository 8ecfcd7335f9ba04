"""From readings and places to forces and shape: bounded QP, estimate step, nonlinear estimate."""
