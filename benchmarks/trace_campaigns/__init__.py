"""Short wear campaigns with undeclared effects, for judging the tracing: tables of them, and their making.

`tune` may be looked at while the tracing is worked on, `judge` may not; they share no seed and no condition.
"""
