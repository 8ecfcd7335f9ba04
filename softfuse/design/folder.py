"""The folder of a design run: whose it is, and all that was tried, as a Parquet file."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from softfuse.design.problem import Value
from softfuse.design.search import Trial
from softfuse.errors import SoftfuseError
from softfuse.io.result_folder import claim, put_in_place, writing

_NAME, _HISTORY = "design.json", "history.parquet"


class DesignFolder:
    """Keeps the trials of a run's searches, each under the name of its search."""

    def __init__(
        self, path: Path, identity: Mapping[str, str], parameters: Sequence[str], measures: Sequence[str]
    ) -> None:
        """Make the folder, or find the run in it; raises SoftfuseError when there is another one in it."""
        self._path, self._parameters, self._measures = path, tuple(parameters), tuple(measures)
        claim(path, _NAME, "a design run", identity, parts=_HISTORY)
        self._trials = list(self._kept())

    @property
    def trials(self) -> tuple[tuple[str, Trial], ...]:
        """All trials with the names of their searches, in the order in which they were computed."""
        return tuple(self._trials)

    def known(self, search: str) -> list[Trial]:
        """The trials of a search."""
        return [trial for name, trial in self._trials if name == search]

    def add(self, search: str, trial: Trial) -> bool:
        """Keep a trial and tell whether it is new; raises SoftfuseError when it cannot be written."""
        key = trial.leg, trial.theta.tobytes()
        if any(key == (each.leg, each.theta.tobytes()) for each in self.known(search)):
            return False
        self._trials.append((search, trial))
        self._write()
        return True

    def _write(self) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        count = len(self._measures)
        none = Value(np.full(count, np.nan), np.full((count, len(self._parameters)), np.nan))
        values = [trial.value or none for _, trial in self._trials]
        theta = np.array([trial.theta for _, trial in self._trials])
        measures = np.array([value.measures for value in values])
        columns = {
            "search": [name for name, _ in self._trials],
            "leg": [trial.leg for _, trial in self._trials],
            "mesh_worn": [trial.value is None for _, trial in self._trials],
            **{f"parameter {name}": theta[:, k] for k, name in enumerate(self._parameters)},
            **{f"measure {name}": measures[:, k] for k, name in enumerate(self._measures)},
            "slopes": [value.slopes.ravel().tolist() for value in values],
        }
        with writing(self._path), put_in_place(self._path / _HISTORY) as part:
            pq.write_table(pa.table(columns), part, compression="zstd", write_page_checksum=True)

    def _kept(self) -> Iterator[tuple[str, Trial]]:
        import pyarrow as pa
        import pyarrow.parquet as pq

        file = self._path / _HISTORY
        if not file.exists():
            return
        try:
            rows = pq.read_table(file, page_checksum_verification=True).to_pylist()
        except (OSError, pa.ArrowException) as error:
            reason = str(error).partition("\n")[0]
            raise SoftfuseError(f"{file} cannot be read: {reason}; remove it to begin anew") from error
        shape = len(self._measures), len(self._parameters)
        for row in rows:
            theta = np.array([row[f"parameter {name}"] for name in self._parameters])
            measures = np.array([row[f"measure {name}"] for name in self._measures])
            value = None if row["mesh_worn"] else Value(measures, np.array(row["slopes"]).reshape(shape))
            yield row["search"], Trial(row["leg"], theta, value)
