"""The folder of a sweep: which sweep it is, and a Parquet file for each chunk that is finished."""

import json
import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from softfuse.experiment.sweep_table import SweepColumn, Value
from softfuse.io.result_folder import claim, put_in_place, writing

if TYPE_CHECKING:
    import pyarrow as pa

log = logging.getLogger(__name__)

_NAME = "sweep.json"
_MARK = b"softfuse.sweep"


class SweepFolder:
    """Reads and writes the files of one sweep."""

    def __init__(self, path: Path, identity: Mapping[str, str], columns: Sequence[SweepColumn]):
        """Make the folder, or find the sweep in it; raises SoftfuseError when there is another one in it."""
        self._path, self._columns = path, columns
        about = {"columns": {column.name: column.about for column in columns}}
        self._identity = claim(path, _NAME, "a sweep", identity, about=about, parts="part-*.parquet")

    def has(self, number: int, cases: int) -> bool:
        """Whether the file of a chunk of so many cases is there and whole."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        part = self._part(number)
        try:
            metadata = pq.read_metadata(part)
        except FileNotFoundError:
            return False
        except (OSError, pa.ArrowException) as error:
            log.warning("%s cannot be read and is made anew: %s", part, str(error).partition("\n")[0])
            return False
        own = self._schema().metadata[_MARK]
        if metadata.num_rows == cases and (metadata.metadata or {}).get(_MARK) == own:
            return True
        log.warning("%s is of another sweep or not whole and is made anew", part)
        return False

    def write(self, number: int, rows: Sequence[Sequence[Value]]) -> None:
        """Write the rows of a chunk; its file appears when it is whole. SoftfuseError when it cannot be."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        schema = self._schema()
        columns = zip(schema, zip(*rows, strict=True), strict=True)
        table = pa.Table.from_arrays(
            [pa.array(values, field.type) for field, values in columns], schema=schema
        )
        with writing(self._path), put_in_place(self._part(number)) as part:
            pq.write_table(table, part, compression="zstd", write_page_checksum=True)

    def results(self, chunks: int) -> Counter[str]:
        """How often the cases of so many chunks ended in which way."""
        import pyarrow.dataset as ds

        files = [str(self._part(number)) for number in range(chunks)]
        found = ds.dataset(files, schema=self._schema()).to_table(columns=["result"])
        return Counter(found.column("result").to_pylist())

    def _schema(self) -> "pa.Schema":
        import pyarrow as pa

        types = {"integer": pa.int64(), "number": pa.float64(), "text": pa.string()}
        fields = [
            pa.field(column.name, types[column.kind], metadata={"about": column.about})
            for column in self._columns
        ]
        return pa.schema(fields, metadata={_MARK: json.dumps(self._identity)})

    def _part(self, number: int) -> Path:
        return self._path / f"part-{number:05d}.parquet"
