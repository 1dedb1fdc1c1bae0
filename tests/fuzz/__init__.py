"""Fuzzing: hypothesis over every command (test_commands.py), atheris over every reader (``python -m tests.fuzz``)."""
