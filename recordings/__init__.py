"""Recorded campaigns, the rigs they were made on, and the generator that makes them."""
