"""Timed runs and evaluations: commands, not tests."""

import service  # noqa: F401 - one thread for linear algebra, as in the program; before numpy is imported
