"""Small robots for tests of virtual ones: a block that is pressed, and a beam that a cable and a chamber
bend.
"""

from dataclasses import replace
from pathlib import Path

import equinox as eqx

from softfuse.experiment.virtual_robot import MakingErrors, VirtualRobot, virtual_robot
from softfuse.mechanics.sparse import SparseLU
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


FINGER = """
[robot]
name = "Short Finger"

[body.source]
type = "finger"
size = ["50 mm", "20 mm", "20 mm"]
neck_x = ["25 mm"]
neck_length = "12 mm"
neck_height = "15 mm"
cavity_size = ["8 mm", "6 mm", "10 mm"]
wall_size = "1 m"
base_size = "30 mm"
growth = 0.0

[[body.material]]
law = "neo-hookean"
young = "0.6 MPa"
poisson = 0.49

[body.fixed]
x = ["0 mm", "0 mm"]

[[chamber]]
name = "left"
centre = ["25 mm", "5 mm", "12.5 mm"]
gas = "sealed"
dead_volume = "100 mm^3"

[[chamber]]
name = "right"
centre = ["25 mm", "-5 mm", "12.5 mm"]
gas = "sealed"
dead_volume = "100 mm^3"

[[cable]]
name = "palm"
guides = [
    ["5 mm", "0 mm", "3 mm"], ["15 mm", "0 mm", "3 mm"], ["35 mm", "0 mm", "3 mm"], ["45 mm", "0 mm", "3 mm"],
]
pulled_at = ["-5 mm", "0 mm", "3 mm"]
anchor_radius = "2.5 mm"
max_tension = "20 N"

[[contact]]
name = "hand"
model = "patch"
radius = "4 mm"
max_force = "5 N"
span = "10 mm"
at_once = 2

[[point]]
name = "end"
at = ["47 mm", "0 mm", "10 mm"]

[[sensor]]
name = "pressure"
type = "pressure"
part = "MPX5100A"
chambers = ["left", "right"]
channels = ["pressure0_V", "pressure1_V"]

[[sensor]]
name = "electrodes"
type = "electrodes"
contact = "hand"
channels = ["electrode0", "electrode1"]
noise_counts = 8.0
lowest_counts = 0.0
highest_counts = 65535.0

[[sensor.electrodes]]
name = "base left"
centre = ["10 mm", "10 mm", "10 mm"]
direction = [0, -1, 0]
along = [1, 0, 0]
size = ["10 mm", "12 mm"]

[[sensor.electrodes]]
name = "tip left"
centre = ["40 mm", "10 mm", "10 mm"]
direction = [0, -1, 0]
along = [1, 0, 0]
size = ["10 mm", "12 mm"]

[[sensor]]
name = "cable"
type = "cable-length"
cables = ["palm"]
channels = ["cable0_mm"]
"""


def settings_of(text: str, *changes: tuple[str, str]) -> RobotSettings:
    """The settings of a text in which some passages are replaced."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return parse(text, Path("robot.toml"))


def quick_robot(settings: RobotSettings, errors: MakingErrors) -> VirtualRobot:
    """A virtual robot whose programs compile faster than with the solver that larger bodies need."""
    robot = virtual_robot(settings, errors)
    model = eqx.tree_at(lambda m: m.linear, robot.made.model, SparseLU.plan(robot.made.parts.body))
    return replace(robot, made=replace(robot.made, model=model))
