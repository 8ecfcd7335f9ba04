"""The charts of a device: for each cell of the workspace a reduced device, read when a contact gets there."""

from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

import numpy as np

from softfuse.errors import SoftfuseError
from softfuse.estimation.device import Device
from softfuse.estimation.kept_device import Kept, Sizes, kept_sizes, read_device, write_device
from softfuse.reduction.basis import Basis
from softfuse.reduction.cells import Cells

_IN_MEMORY = 256
"""Charts; one of the pad takes 5 MB."""


@dataclass(frozen=True)
class AtlasFolder:
    """Where charts are, and the `mark` of what they were made from."""

    path: Path
    mark: str

    def file(self, number: int) -> Path:
        """The file of a cell's chart."""
        return self.path / f"chart-{number:04d}.npz"

    def has(self, number: int) -> bool:
        """Whether the chart of a cell is there; raises SoftfuseError for one of another device."""
        return self.file(number).exists() and bool(kept_sizes(self.file(number), self.mark))

    def write(self, number: int, device: Device, basis: Basis) -> None:
        """Write the chart of a cell. Raises OSError when it cannot be written."""
        write_device(self.file(number), device, basis, self.mark)


class Atlas:
    """All charts of a full device, in equal sizes."""

    def __init__(self, full: Device, cells: Cells, folder: AtlasFolder):
        """See that all charts are there. Raises SoftfuseError when one is missing, damaged, or was made for
        another device.
        """
        self.full, self.cells, self._folder = full, cells, folder
        missing = [number for number in range(len(cells)) if not folder.file(number).exists()]
        if missing:
            raise SoftfuseError(
                f"{len(missing)} of {len(cells)} charts are missing in {folder.path}: "
                "run softfuse reduce with this folder"
            )
        sizes = [kept_sizes(folder.file(number), folder.mark) for number in range(len(cells))]
        points = np.max([each.points for each in sizes], axis=0)
        self._sizes = Sizes(tuple(map(int, points)), max(each.watched for each in sizes))
        self._kept: OrderedDict[int, Kept] = OrderedDict()
        self._lock = Lock()

    def chart(self, number: int) -> Kept:
        """The chart of a cell. Raises SoftfuseError when its file is gone or damaged."""
        with self._lock:
            kept = self._kept.get(number)
        if kept is None:
            kept = read_device(self._folder.file(number), self._folder.mark, self.full, self._sizes)
        with self._lock:
            self._kept[number] = kept
            self._kept.move_to_end(number)
            if len(self._kept) > _IN_MEMORY:
                self._kept.popitem(last=False)
        return kept
