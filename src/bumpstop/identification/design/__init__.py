"""Design of experiments: motions that make parameters identifiable, and their files."""
