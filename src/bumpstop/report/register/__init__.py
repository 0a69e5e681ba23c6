"""Pages of registers: all contact situations of a cell, and the dossier that is signed."""
