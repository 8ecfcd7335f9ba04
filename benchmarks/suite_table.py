"""The suite's table, from what pytest-benchmark has written.

    .venv/bin/python benchmarks/suite_table.py out/benchmarks/suite.json

Printed in Markdown, as it stands in the README: date, machine and commit; every benchmark's median and what
it says beside; and the exponents with which times grow over the nodes.
"""

import argparse
import json
from itertools import groupby
from pathlib import Path

import numpy as np

SAID = {
    "p99_ms": "99 % {:.3g} ms",
    "memory_MB": "{:.0f} MB",
    "retraced": "{} retraced",
    "a_second": "{:.3g} a second",
    "teaching_s": "taught in {:.0f} s",
    "compile_s": "compiled in {:.0f} s",
    "inputs": "{:,} inputs",
    "force_off_N": "force off by {:.2g} N",
}
"""What stands beside a time, and how."""


def name(benchmark: dict) -> str:
    """What a benchmark is of, without the size: of such of one name, times are fitted over the nodes."""
    given = benchmark["params"] or {}
    kinds = [str(value) for key, value in given.items() if key not in ("nodes", "mesh", "count", "contacts")]
    return " ".join([benchmark["name"].split("[")[0].removeprefix("test_").replace("_", " "), *kinds])


def milliseconds(seconds: float) -> str:
    """A time in three digits."""
    return f"{1e3 * seconds:,.3g} ms" if seconds < 10 else f"{seconds:.3g} s"


def table(found: dict) -> str:
    """All of it, in Markdown."""
    machine, commit = found["machine_info"], found["commit_info"]
    lines = [
        f"{found['datetime'][:10]}, {machine['cpu'].get('count', '?')} cores of {machine['machine']}, commit "
        f"{commit['id'][:7]}{' with changes' if commit['dirty'] else ''}:",
        "",
        "| benchmark | size | median | beside |",
        "|---|---|---|---|",
    ]
    exponents = []
    for what, group in groupby(sorted(found["benchmarks"], key=name), name):
        several = list(group)
        for each in several:
            told = each["extra_info"]
            counts = ("nodes", "unknowns", "contacts", "count", "devices")
            size = ", ".join(f"{told[key]:,} {key}" for key in counts if key in told)
            beside = ", ".join(text.format(told[key]) for key, text in SAID.items() if key in told)
            lines.append(f"| {what} | {size} | {milliseconds(each['stats']['median'])} | {beside} |")
        nodes = [each["extra_info"].get("nodes") for each in several]
        if None not in nodes and len(set(nodes)) > 1:
            times = [each["stats"]["median"] for each in several]
            slope = np.polyfit(np.log(nodes), np.log(times), 1)[0]
            exponents.append(f"{what}: nodes^{slope:.2f}")
    return "\n".join([*lines, "", "Growth: " + "; ".join(exponents) + "."])


def main() -> None:
    """Read the file that is named, print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file", type=Path)
    print(table(json.loads(parser.parse_args().file.read_text())))


if __name__ == "__main__":
    main()
