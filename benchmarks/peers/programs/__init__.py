"""The peers' own programs: each runs in its peer's environment and imports numpy, its peer and `exchange` alone."""
