"""What tests/benchmarks/every_widget.py does with a viewer in a real window."""
