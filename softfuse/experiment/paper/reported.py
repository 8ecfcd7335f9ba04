"""Figures that Navarro et al., RA-L 5(4), 2020, report of their own robots: mean errors by group of samples.

Only those of them that softfuse has at hand; the paper's tables hold more.
"""

LOCATION_ERROR_MM = {"all": 1.08}
"""Table I: of the pad."""

FORCE_ERROR_PERCENT = {"all": 10.9, "circle": 7.8}
"""Table II: of the pad; the circle is that of `accuracy.WORKSPACE_CIRCLE_M`."""

POSITION_ERROR_MM = {"all": 1.26}
"""Table III: of points of the finger."""
