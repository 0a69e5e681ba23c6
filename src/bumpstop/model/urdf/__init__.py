"""Robots from URDF files and into them."""
