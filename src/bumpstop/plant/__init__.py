"""A physical arm in MuJoCo to experiment on: it makes recordings, and knows what is true."""

from bumpstop.plant.command import Command, PlantReaction, along, line
from bumpstop.plant.drive import Gears
from bumpstop.plant.experiment import Experiment
from bumpstop.plant.mjcf import mjcf
from bumpstop.plant.motions import pick_and_place, press, workspace
from bumpstop.plant.objects import PlantObject, gauge_regions, object_kinds
from bumpstop.plant.plant import Plant
from bumpstop.plant.run import PlantRun, PlantTrace
from bumpstop.plant.sample import Sample
from bumpstop.plant.sensors import Sensors
from bumpstop.plant.servo import Servo

__all__ = [
    "Command",
    "Experiment",
    "Gears",
    "Plant",
    "PlantObject",
    "PlantReaction",
    "PlantRun",
    "PlantTrace",
    "Sample",
    "Sensors",
    "Servo",
    "along",
    "gauge_regions",
    "line",
    "mjcf",
    "object_kinds",
    "pick_and_place",
    "press",
    "workspace",
]
