"""Wear of the tooth flanks: profiles, Archard's law, and how wear and vibration drive each other."""
