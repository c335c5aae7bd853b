"""From the residual between twin and machine to the physical effect that the twin lacks."""
