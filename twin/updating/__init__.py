"""From a window's features to the twin's parameters: calibration, wear depth, wear coefficient, remaining life."""
