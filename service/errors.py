"""What can go wrong at the edges.

ServiceError
├── InputError   something handed in that cannot be used: what, where, what would be right (exit status 2)
│   └── FrameError   one frame that breaks the contract: topic, field, value, allowed range
└── DeliveryError    a stream that could not be delivered or joined in time
"""


class ServiceError(Exception):
    """Base of every error that the service raises on purpose."""


class InputError(ServiceError):
    """Input that cannot be used."""


class FrameError(InputError):
    """A frame outside the contract's limits."""


class DeliveryError(ServiceError):
    """Frames that could not be handed over."""


FAULT = "a fault of the program"
"""How the reason begins where not the input was wrong but the program."""
