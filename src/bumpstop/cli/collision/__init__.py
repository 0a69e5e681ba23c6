"""Commands that ask how hard a collision is: evaluate, require, study."""
