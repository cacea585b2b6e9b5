"""deformrf-train with --view, the model while it is trained; train_command.main is the program."""
