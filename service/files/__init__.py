"""Files that a person writes or hands over: rigs, mappings, baselines, relations, series."""
