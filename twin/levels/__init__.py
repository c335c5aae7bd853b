"""Level of vibration against wear depth, beyond the depths at which a steady state exists."""
