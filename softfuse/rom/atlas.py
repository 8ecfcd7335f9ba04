"""The charts of a device: for each region where contacts may be a reduced device, read when asked for."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from softfuse.errors import SoftfuseError
from softfuse.mechanics.model import Model
from softfuse.rom.basis import Basis
from softfuse.rom.cells import AbstractRegions
from softfuse.rom.rom_file import Kept, Sizes, kept_sizes, read_device, write_device


@dataclass(frozen=True)
class AtlasFolder:
    """Where charts are, and the `mark` of what they were made from."""

    path: Path
    mark: str

    def file(self, number: int) -> Path:
        """The file of a region's chart."""
        return self.path / f"chart-{number:04d}.npz"

    def has(self, number: int) -> bool:
        """Whether the chart of a region is there; raises SoftfuseError for one of another device."""
        return self.file(number).exists() and bool(kept_sizes(self.file(number), self.mark))

    def write(self, number: int, device: Model, basis: Basis) -> None:
        """Write the chart of a region. Raises OSError when it cannot be written."""
        write_device(self.file(number), device, basis, self.mark)


class Atlas:
    """All charts of a full device, in equal sizes."""

    def __init__(self, full: Model, regions: AbstractRegions, folder: AtlasFolder):
        """See that all charts are there. Raises SoftfuseError when one is missing, damaged, or was made for
        another device.
        """
        self.full, self.regions, self._folder = full, regions, folder
        missing = [number for number in range(len(regions)) if not folder.file(number).exists()]
        if missing:
            raise SoftfuseError(
                f"{len(missing)} of {len(regions)} charts are missing in {folder.path}: "
                "run softfuse reduce with this folder"
            )
        sizes = [kept_sizes(folder.file(number), folder.mark) for number in range(len(regions))]
        points = np.max([each.points for each in sizes], axis=0)
        self._sizes = Sizes(tuple(map(int, points)), max(each.watched for each in sizes))
        self._kept: dict[int, Kept] = {}

    def chart(self, number: int) -> Kept:
        """The chart of a region. Raises SoftfuseError when its file is gone or damaged."""
        if number not in self._kept:
            file, mark = self._folder.file(number), self._folder.mark
            self._kept[number] = read_device(file, mark, self.full, self._sizes)
        return self._kept[number]
