"""What came of an experiment: the recording, the truth behind it, and how to keep both."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError, where_else
from bumpstop.output_files import write_bytes, write_parquet
from bumpstop.recording import Recording
from bumpstop.text_files import to_toml

if TYPE_CHECKING:
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot
    from bumpstop.plant.drive import Drives
    from bumpstop.plant.objects import PlantObject
    from bumpstop.plant.sensors import Sensors
    from bumpstop.plant.servo import Servo

RECORDING, TRUTH, TRACE = "recording.parquet", "truth.toml", "trace.parquet"


@dataclass(frozen=True, eq=False, kw_only=True)
class PlantTrace:
    """What was true, every millisecond.

    Attributes:
        t: (N,) [s].
        q, qd, qdd: of the joints (N, dof) [rad or m]; rates and accelerations are the motors'.
        tau: what the gears pass on to rotor and link (N, dof) [Nm or N].
        friction: what they keep (N, dof).
        contact_force: on each object along its normal (N, objects) [N].
        measured_force: what a gauge shows, its spring's force; of other objects the contact force (N, objects) [N].
    """

    t: FloatArray
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    tau: FloatArray
    friction: FloatArray
    contact_force: FloatArray
    measured_force: FloatArray

    @classmethod
    def empty(cls, rows: int, dof: int, objects: int) -> PlantTrace:
        """Room for so many rows."""
        of_joints = {name: np.zeros((rows, dof)) for name in ("q", "qd", "qdd", "tau", "friction")}
        forces = {name: np.zeros((rows, objects)) for name in ("contact_force", "measured_force")}
        return cls(t=np.zeros(rows), **of_joints, **forces)

    def note(
        self,
        row: int,
        q: FloatArray,
        qd: FloatArray,
        qdd: FloatArray,
        given: FloatArray,
        against: FloatArray,
        damping: FloatArray,
    ) -> None:
        """Write down a millisecond: what motors give and gears keep, the damped part by its rate (dof,) each."""
        self.q[row], self.qd[row], self.qdd[row] = q, qd, qdd
        damped = damping * qd
        self.tau[row] = given - against - damped
        self.friction[row] = against + damped

    def cut(self, t: FloatArray) -> PlantTrace:
        """As many rows as there are times, which they get."""
        names = ("q", "qd", "qdd", "tau", "friction", "contact_force", "measured_force")
        of_joints = {name: getattr(self, name)[: len(t)].copy() for name in names}
        return replace(self, t=t, **of_joints)


@dataclass(frozen=True, eq=False, kw_only=True)
class SampleLog:
    """What sensors need to know of the moments at which they sample, before noise.

    Attributes:
        step: integration steps (N,), rising.
        q, qd: of the motors (N, dof).
        given: by the motors (N, dof) [Nm or N].
        taken: by friction of the joint model (N, dof) [Nm or N].
        wrench: MuJoCo's (N, 6).
    """

    step: npt.NDArray[np.int64]
    q: FloatArray
    qd: FloatArray
    given: FloatArray
    taken: FloatArray
    wrench: FloatArray

    @classmethod
    def empty(cls, step: npt.NDArray[np.int64], dof: int) -> SampleLog:
        """Room for these steps."""
        of_joints = {name: np.zeros((len(step), dof)) for name in ("q", "qd", "given", "taken")}
        return cls(step=step, wrench=np.zeros((len(step), 6)), **of_joints)

    def note(
        self, row: int, q: FloatArray, qd: FloatArray, given: FloatArray, taken: FloatArray, wrench: FloatArray
    ) -> None:
        """Write down one moment."""
        self.q[row], self.qd[row], self.given[row], self.taken[row] = q, qd, given, taken
        self.wrench[row] = wrench[:6]

    def cut(self, rows: int) -> SampleLog:
        """The first rows."""
        names = ("step", "q", "qd", "given", "taken", "wrench")
        return replace(self, **{name: getattr(self, name)[:rows] for name in names})


@dataclass(frozen=True, eq=False)
class PlantRun:
    """One experiment.

    Attributes:
        recording: what the controller reported: t, q, current and wrench.
        truth: what the plant is made of, and what happened; plain values.
        trace: what was true every millisecond.
        reaction_time: when the arm began to react [s], or None.
        lost: samples that got lost.
        notes: what was cut short, and what could not be modelled.
    """

    recording: Recording
    truth: dict[str, Any]
    trace: PlantTrace
    reaction_time: float | None
    lost: int
    notes: tuple[str, ...]

    @classmethod
    def of(
        cls,
        robot: Robot,
        truth: dict[str, Any],
        notes: tuple[str, ...],
        rows: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
        trace: PlantTrace,
        reaction_time: float | None,
        lost: int,
    ) -> PlantRun:
        """Put together what a plant wrote down; ``rows`` are t, q, current and wrench."""
        t, q, current, wrench = rows
        if len(t) < 2:
            problem = f"gave {len(t)} samples"
            raise InputError("motion", problem, "wanted at least 2: a longer motion or a higher rate")
        recording = Recording(
            t=t,
            q=q,
            current=current,
            wrench=wrench,
            joint_names=tuple(joint.name for joint in robot.joints),
            robot=robot.name,
        )
        happened: dict[str, Any] = {
            "samples": len(t),
            "lost": lost,
            "duration_s": float(trace.t[-1]),
            "peak_force_N": [float(force) for force in trace.contact_force.max(axis=0)],
            "peak_measured_force_N": [float(force) for force in trace.measured_force.max(axis=0)],
        }
        if reaction_time is not None:
            happened["reaction_s"] = reaction_time
        return cls(recording, truth | {"run": happened}, trace, reaction_time, lost, notes)

    @property
    def peak_force(self) -> float:
        """Greatest force on any object, by the millisecond [N]."""
        return float(self.trace.contact_force.max(initial=0.0))

    def save(self, folder: str | Path) -> list[Path]:
        """Write the recording, the truth and the trace into a folder; returns their paths.

        Raises:
            InputError: the folder cannot be written.
        """
        import polars as pl

        out = Path(folder)
        try:
            out.mkdir(parents=True, exist_ok=True)
            self.recording.save(out / RECORDING)
            write_bytes(out / TRUTH, to_toml(self.truth).encode("utf-8"))
            columns: dict[str, Any] = {"t": self.trace.t}
            for stem in ("q", "qd", "qdd", "tau", "friction", "contact_force", "measured_force"):
                value = getattr(self.trace, stem)
                columns |= {f"{stem}_{j + 1}": value[:, j] for j in range(value.shape[1])}
            write_parquet(out / TRACE, pl.DataFrame(columns))
        except OSError as error:
            problem = f"{str(folder)!r} cannot be written ({error.strerror or error})"
            raise InputError("--out", problem, where_else(error)) from None
        return [out / name for name in (RECORDING, TRUTH, TRACE)]


class PlantParts(Protocol):
    """What a plant is made of; :class:`bumpstop.plant.Plant` says what each is."""

    robot: Robot
    joint_model: JointTorqueModel | None
    drives: Drives
    objects: tuple[PlantObject, ...]
    seed: int
    gravity: tuple[float, ...]
    servo: Servo
    sensors: Sensors


def truth_of(plant: PlantParts) -> dict[str, Any]:
    """All parameters of a plant as plain values, in the order of a file."""
    import mujoco

    from bumpstop.joint.friction_law import OF_FRICTION
    from bumpstop.plant.servo import STEP

    drives = plant.drives
    joints = []
    for j, name in enumerate(drives.names):
        modelled = plant.joint_model is not None and name not in drives.unmodelled
        row: dict[str, Any] = {"name": name, "modelled": modelled}
        row |= {"map": "odd" if drives.odd[j] else "load_dependent", "A": drives.A[j], "B": drives.B[j]}
        law = drives.laws[j]
        row |= {"friction": law} | {key: getattr(drives, key)[j] for key in OF_FRICTION.get(law, ())}
        row |= {
            "hysteresis_Nm": drives.hysteresis[j],
            "rest_speed_rad_s": drives.rest[j],
            "inertia_kg_m2": drives.inertia[j],
            "friction_sd": drives.scatter[j],
            "friction_sd_per": drives.gears.scatter_per,
            "load_share": drives.load_share[j],
            "extra_stribeck_Nm": drives.extra[j],
            "extra_stribeck_speed_rad_s": drives.extra_speed[j],
            "ripple_Nm": drives.ripple[j],
            "ripple_per_turn": drives.waves[j],
            "presliding_rad": drives.presliding[j],
            "stiffness_Nm_rad": drives.stiffness[j],
            "damping_Nm_s_rad": drives.damping[j],
        }
        joints.append({key: float(value) if isinstance(value, np.floating) else value for key, value in row.items()})
    objects = [
        {
            "name": thing.name,
            "position_m": list(thing.position),
            "normal": list(thing.direction),
            "stiffness_N_m": thing.stiffness,
            "moving_mass_kg": thing.moving_mass,
            "damping_N_s_m": thing.damping,
            "status": thing.status,
            "source": thing.source,
        }
        | ({} if thing.body_mass is None else {"body_mass_kg": thing.body_mass})
        | ({} if thing.spring is None else {"spring_N_m": thing.spring})
        for thing in plant.objects
    ]
    return {
        "robot": plant.robot.name,
        "inertia_status": plant.robot.inertia_status,
        "unit": "Nm" if plant.joint_model is None else plant.joint_model.unit,
        "seed": plant.seed,
        "gravity_m_s2": list(plant.gravity),
        "step_s": STEP,
        "mujoco": mujoco.__version__,
        "servo": asdict(plant.servo),
        "sensors": sensors_truth(plant.sensors),
        "joint": joints,
        "object": objects,
    }


def sensors_truth(sensors: Sensors) -> dict[str, Any]:
    """Sensors as plain values."""
    return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(sensors).items()}
