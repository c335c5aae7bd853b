"""A pair as bodies on shafts, integrated in time: contacts by an impact law, bearings and shafts that give way."""
