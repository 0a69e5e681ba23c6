"""Schroeder (2013): single joints by a protocol, the collisions of chapter 4, and their pages."""
