"""Slopes of the L2 error against a manufactured solution, and locking: which elements survive ν near 0.5.

The exact map x = X + a s(Y) s(Z) e_x, then y += b s(x) s(Z), with s(t) = sin πt, preserves volume (two shears, so J = 1 and p = 0 for
every λ); a second, compressible map has p ≠ 0. The dead body force b = −Div P(∇x) and the boundary displacements make it the solution.
"""
