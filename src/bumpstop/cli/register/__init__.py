"""Commands of cells with many contact situations: new, report, and evaluate of a register."""
