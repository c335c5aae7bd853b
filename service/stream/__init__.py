"""Frames of a stream, in order, as whole measurement windows."""
