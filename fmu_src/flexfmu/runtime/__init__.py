"""The part that travels inside the FMU: NumPy and h5py only, relative imports only."""
