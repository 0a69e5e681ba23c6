"""Commands that only reproduce Schroeder (2013): experiment, and identify by its protocol."""
