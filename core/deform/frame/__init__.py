"""One frame of the solver: the NumPy reference, the CPU and the CUDA kernel."""
