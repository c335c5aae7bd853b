"""What can go wrong in the core.

TwinError
├── ParameterError   a value that no gearbox can have: name, value, unit, allowed range, likely cause
│   └── ImpossibleSize   the same of a number of an effect: what a fit gives such a size is not this effect
├── NotAvailable     a quantity whose inputs are not known: what, and what is missing
├── WindowError      a measurement window that cannot be used: gap, overlap, wrong rate, no samples
└── NotConverged     a solver's answer that is no answer: which, residual, tolerance

A poor fit is a result, not an exception.
"""


class TwinError(Exception):
    """Base of every error that the core raises on purpose."""


class ParameterError(TwinError):
    """A value outside what is physically possible, or a name that is not known."""


class ImpossibleSize(ParameterError):
    """A number of an effect outside what makes sense: an effect that is fitted so is not there."""


class NotAvailable(TwinError):
    """A quantity that cannot be computed because something it needs is not known."""


class WindowError(TwinError):
    """A measurement window that cannot be used as it is."""


class NotConverged(TwinError):
    """A solver stopped before it reached its tolerance."""
