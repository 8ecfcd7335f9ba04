"""Small robots for tests of virtual ones: a block that is pressed, and a beam that a cable and a chamber
bend.
"""

from pathlib import Path

from softfuse.robot.file import parse
from softfuse.robot.settings import RobotSettings

BLOCK = """
[robot]
name = "Block"

[body.source]
type = "pad"
size = ["70 mm", "40 mm", "18 mm"]
cavity_size = ["26 mm", "28 mm", "6 mm"]
surface_size = "40 mm"
base_size = "40 mm"

[[body.material]]
law = "neo-hookean"
young = "0.6 MPa"
poisson = 0.49

[body.fixed]
z = ["0 mm", "0 mm"]

[[chamber]]
name = "left"
centre = ["-17 mm", "0 mm", "9 mm"]

[[chamber]]
name = "right"
centre = ["17 mm", "0 mm", "9 mm"]

[[contact]]
name = "stage"
model = "punch"
radius = "8 mm"
direction = [0, 0, -1]
max_force = "10 N"
workspace = { x = ["-25 mm", "25 mm"], y = ["-11 mm", "11 mm"] }

[[point]]
name = "top"
at = ["0 mm", "0 mm", "17 mm"]

[[sensor]]
name = "flow"
type = "flow"
part = "D6F-P0001A1"
chambers = ["left", "right"]
channels = ["flow0_V", "flow1_V"]

[[sensor]]
name = "stage"
type = "indenter"
contact = "stage"
channels = ["x_mm", "y_mm", "force_N"]
"""

BEAM = """
[robot]
name = "Beam"

[body.source]
type = "pad"
size = ["70 mm", "20 mm", "18 mm"]
cavity_size = ["40 mm", "8 mm", "6 mm"]
surface_size = "40 mm"
base_size = "40 mm"

[[body.material]]
law = "neo-hookean"
young = "0.6 MPa"
poisson = 0.45

[body.fixed]
x = ["-35 mm", "-35 mm"]

[[chamber]]
name = "bladder"
centre = ["0 mm", "0 mm", "11 mm"]
gas = "driven"
highest = "20 kPa"
command = { channel = "supply_kPa", unit = "kPa" }

[[cable]]
name = "palm"
guides = [["-30 mm", "0 mm", "3 mm"], ["0 mm", "0 mm", "3 mm"], ["30 mm", "0 mm", "3 mm"]]
pulled_at = ["-45 mm", "0 mm", "3 mm"]
anchor_radius = "2 mm"
max_tension = "10 N"
command = { channel = "winch_mm", unit = "mm" }

[[contact]]
name = "hand"
model = "patch"
radius = "5 mm"
max_force = "1 N"
surface = { x = ["0 mm", "30 mm"], normal = [0, 0, 1], angle = "10 deg" }

[[point]]
name = "tip"
at = ["34 mm", "0 mm", "9 mm"]

[[sensor]]
name = "encoder"
type = "cable-length"
cables = ["palm"]
channels = ["encoder_mm"]

[[sensor]]
name = "load cell"
type = "cable-tension"
cables = ["palm"]
channels = ["tension_N"]

[[sensor]]
name = "camera"
type = "marker"
point = "tip"
channels = ["tip_x_mm", "tip_y_mm", "tip_z_mm"]
"""


def settings_of(text: str, *changes: tuple[str, str]) -> RobotSettings:
    """The settings of a text in which some passages are replaced."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return parse(text, Path("robot.toml"))
