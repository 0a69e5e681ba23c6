"""What stands in the three-dimensional picture, as meshes and points; without the browser."""
