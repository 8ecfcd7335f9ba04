from .computing.prepare import prepare_jax
from .design.objective import AbstractMeasure
from .design.of_robot import build_problem
from .design.plan import load_design
from .design.problem import Geometry
from .design.search import Search, SearchSettings
from .errors import SoftfuseError
from .estimation.batch import batched
from .estimation.stream import follow
from .estimation.tracked import Frame, Tracked
from .estimation.tracker import Tracker
from .experiment.performance import Performance, performance, random_episodes
from .experiment.virtual_robot import MakingErrors, virtual_robot
from .functional.chart import facing, moved
from .hardware.recording import Recording
from .mechanics.model import Model, compliance, simulate
from .report.calibration import calibrated_robot
from .report.observability import expected
from .report.presses import read_sensors, sensor_frames
from .report.study import Study
from .robot.file import load, save_edited
from .robot.layout.layout import AbstractLayout, Parameter
from .robot.reduced import with_charts
from .robot.robot import Robot, build_robot
from .robot.settings import RobotSettings
from .robot.trial import Press, Trial

__all__ = [
    "AbstractLayout",
    "AbstractMeasure",
    "Frame",
    "Geometry",
    "MakingErrors",
    "Model",
    "Performance",
    "Press",
    "Recording",
    "Robot",
    "RobotSettings",
    "Search",
    "SearchSettings",
    "SoftfuseError",
    "Study",
    "Tracked",
    "Tracker",
    "Trial",
    "batched",
    "build_problem",
    "build_robot",
    "calibrated_robot",
    "compliance",
    "expected",
    "facing",
    "follow",
    "load",
    "load_design",
    "moved",
    "Parameter",
    "performance",
    "prepare_jax",
    "random_episodes",
    "read_sensors",
    "save_edited",
    "sensor_frames",
    "simulate",
    "virtual_robot",
    "with_charts",
]
