"""What deformrf-report writes: findings of core.study as pages, tables and pictures."""
