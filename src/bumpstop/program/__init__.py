"""Programs of robots in, the same programs with safe speeds out."""
