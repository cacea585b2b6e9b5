"""What tests/benchmarks/kills.py kills: a file for each program, and process.py, which does it."""
