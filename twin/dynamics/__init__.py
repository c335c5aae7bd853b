"""The 21-degree-of-freedom model of the gearbox and its two solvers."""
