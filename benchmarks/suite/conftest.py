"""The suite of benchmarks:

    .venv/bin/python -m pytest benchmarks/suite --benchmark-json=out/benchmarks/suite.json
    .venv/bin/python benchmarks/suite_table.py out/benchmarks/suite.json

All times of one table come from one run: other runs on the same machine differ by more than what is compared.
"""

import sys
from pathlib import Path

import jax

sys.path.insert(0, str(Path(__file__).parents[1]))  # what benchmarks share

jax.config.update("jax_enable_x64", True)
