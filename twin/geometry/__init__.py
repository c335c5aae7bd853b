"""Involute geometry of an external spur pair."""

from twin.geometry.gear_pair import GearPair

__all__ = ["GearPair"]
