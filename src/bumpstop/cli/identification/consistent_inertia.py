"""What ``bumpstop identify --consistent`` says of inertias that bodies can have."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from bumpstop.identification import ConsistentFit


def inertias_json(found: ConsistentFit) -> dict[str, Any]:
    """Links, rotors and torque errors for programs; tensors about the centre of mass, along the link's axes."""
    links = []
    for joint in found.robot.joints:
        assert joint.inertia is not None
        links.append(
            {
                "name": joint.link,
                "mass_kg": joint.inertia.mass,
                "center_m": list(joint.inertia.center),
                "tensor_kg_m2": [list(row) for row in joint.inertia.tensor],
                "rotor_inertia_kg_m2": joint.rotor_inertia,
            }
        )
    joints = [
        {"name": joint.name, "rmse_Nm": float(rmse), "rmse_unconstrained_Nm": float(free)}
        for joint, rmse, free in zip(found.robot.joints, found.rmse, found.rmse_free, strict=True)
    ]
    return {"links": links, "joints": joints}


def print_inertias(found: ConsistentFit) -> None:
    """A line for each link."""
    from bumpstop.model import unit_of

    typer.echo("inertias that bodies can have; what the torque does not show stays near what the robot came with:")
    for joint, rmse, free in zip(found.robot.joints, found.rmse, found.rmse_free, strict=True):
        assert joint.inertia is not None
        at = ", ".join(f"{x:.3g}" for x in joint.inertia.center)
        rotor = f"{joint.rotor_inertia:.3g} {unit_of(joint, turning='kg m2', sliding='kg')}"
        typer.echo(
            f"  {joint.link}: {joint.inertia.mass:.4g} kg at ({at}) m, rotor {rotor}; "
            f"torque error {rmse:.3g} {unit_of(joint)}, {free:.3g} without that condition"
        )
