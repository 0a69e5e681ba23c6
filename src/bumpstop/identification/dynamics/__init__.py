"""Dynamics of a whole arm: base parameters, friction, rotor inertia and gains."""
