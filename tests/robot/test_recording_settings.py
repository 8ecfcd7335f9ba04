"""The table [recording] of a settingsuration, and that it reaches the reader of recordings."""

from pathlib import Path

import numpy as np
import pytest

from softfuse.cli.app import main
from softfuse.errors import ConfigError
from softfuse.hardware.recording import read_recording
from softfuse.report.presses import read_sensors, sensor_frames
from softfuse.robot.file import load


def with_recording(pad_text: str, folder: Path, table: str) -> Path:
    path = folder / "pad.toml"
    path.write_text(pad_text + "\n[recording]\n" + table, encoding="utf-8")
    return path


def test_the_settings_are_read(pad_text, tmp_path):
    table = 'separator = ";"\ndecimal = ","\nrate = "1 kHz"\nencoding = "cp1252"\n'
    table += 'columns = {"P1 [V]" = "flow0_V"}'
    found = load(with_recording(pad_text, tmp_path, table)).recording
    assert (found.separator, found.decimal, found.rate, found.encoding) == (";", ",", 1000.0, "cp1252")
    assert found.columns == {"P1 [V]": "flow0_V"} and found.time is None


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('separator = ","\ndecimal = ","', "recording.decimal: is the separator as well"),
        ('encoding = "utf-9"', "recording.encoding: .* no encoding"),
        ('columns = {a = "x", b = "x"}', 'recording.columns: .*"x" twice'),
        ('layout = "wide"\nid = "sensor"', "recording.id"),
        ('time_unit = "h"', "recording.time_unit"),
        ("rate = 0", "recording.rate"),
        ('seperator = ";"', 'did you mean "separator"'),
    ],
)
def test_mistakes_are_told(pad_text, tmp_path, table, words):
    with pytest.raises(ConfigError, match=words):
        load(with_recording(pad_text, tmp_path, table))


def test_a_foreign_recording_becomes_frames_of_the_robot(pad_text, tmp_path):
    table = 'time_unit = "ms"\ncolumns = {"Durchfluss 1" = "flow0_V"}\n'
    settings = load(with_recording(pad_text, tmp_path, table))
    names = ["Durchfluss 1" if name == "flow0_V" else name for name in settings.channels]
    lines = [";".join(["uhr", *names]), *(";".join(["x", *["0,5"] * len(names)]) for _ in range(3))]
    path = tmp_path / "r.csv"
    path.write_text("\n".join(lines).replace("uhr", "Zeit").replace("x;", "7;"), encoding="utf-16")
    recording = read_sensors(settings, path)
    frames = list(sensor_frames(settings, recording))
    assert len(frames) == 3 and frames[0].time_s == 0.007
    assert all(frame.raw.shape == (len(names),) and np.all(frame.raw == 0.5) for frame in frames)


def test_convert_takes_a_format_from_a_file_with_that_table_alone(tmp_path, capsys):
    table = tmp_path / "format.toml"
    table.write_text('[recording]\nrate = "100 Hz"\ncolumns = {P = "a_V"}\n')
    source, target = tmp_path / "r.csv", tmp_path / "c.csv"
    source.write_text("P,state\n1,x\n2,y\n")
    with pytest.raises(SystemExit) as done:
        main(["convert", str(source), str(target)])
    assert done.value.code == 2 and "lacks the column 'time_s'" in capsys.readouterr().err
    with pytest.raises(SystemExit) as done:
        main(["convert", str(source), str(target), "--format", str(table)])
    assert done.value.code == 0
    recording = read_recording(target, ["a_V"])
    assert recording.time_s.tolist() == [0.0, 0.01] and recording.columns["a_V"].tolist() == [1.0, 2.0]
    table.write_text('[recordings]\nrate = "100 Hz"\n')
    with pytest.raises(SystemExit):
        main(["convert", str(source), str(target), "--format", str(table)])
    assert "recording: missing" in capsys.readouterr().err
