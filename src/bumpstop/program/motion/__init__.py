"""The motions of moves: paths of the joints, and how they are gone along."""
