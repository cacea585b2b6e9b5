"""One frame of the solver, for the CPU and for CUDA."""
