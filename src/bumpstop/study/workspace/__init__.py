"""Workspace: poses and directions all over the reach of an arm."""
