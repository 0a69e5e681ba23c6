"""What only reproduces Schroeder (2013): its figures, its study of random poses, its protocol and its collisions."""
