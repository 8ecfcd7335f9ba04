"""The test beds of Navarro et al., IEEE RA-L 5(4), 2020, DOI 10.1109/LRA.2020.3008120, and the figures they
report.
"""
