"""From volumes and locations to forces and shape: compliance, bounded QP, estimate step,
nonlinear estimate.
"""
