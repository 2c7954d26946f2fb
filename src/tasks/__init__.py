"""What `run.py` can do: one module a task, each called with the composed configuration."""
