"""What stands between the motors of an arm and its links, what is assumed where nothing is published, and its files."""

from bumpstop.model.drive_train.drive_train import DriveTrain
from bumpstop.model.drive_train.drive_train_file import load_drive_train
from bumpstop.model.drive_train.entry import DriveTrainEntry, DriveTrainStatus

__all__ = ["DriveTrain", "DriveTrainEntry", "DriveTrainStatus", "load_drive_train"]
