"""The detector as a control loop takes it: in the form of the kernels, and as a file that C++ programs read."""
